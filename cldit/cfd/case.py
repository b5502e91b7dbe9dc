"""What any CFD reader yields, in the case's own coordinates, before it becomes a spray."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cldit.cfd.cell_mesh import AnyFloats, CellMesh
from cldit.errors import SprayError
from cldit.spray.result import Floats

CLOUD_FIELDS = ("d", "nParticle", "T", "rho")
TIME_TOLERANCE = 1e-6  # relative; OpenFOAM writes times with six digits, foamToVTK as float32


@dataclass(frozen=True)
class Column:
    """Values (N,) or (N, 3), and the file and field to name when they are wrong."""

    label: str
    values: AnyFloats


@dataclass(frozen=True)
class Cloud:
    """Parcels: positions (N, 3) and fields by name (d, nParticle, T, rho; U and age if given)."""

    name: str
    position_m: Column
    fields: Mapping[str, Column]


@dataclass(frozen=True)
class Injector:
    """Where and whither the case's dictionary `source` injects, (3,) each."""

    source: str
    position_m: Floats
    direction: Floats


@dataclass(frozen=True)
class CfdCase:
    """One time of a case: mesh, cell fields by name (N,), cloud, injectors; time_s if known.

    `gas` holds those of the fields asked for that there are, `available` the names of all.
    """

    source: str
    time_s: float | None
    mesh: CellMesh
    gas: Mapping[str, Column]
    available: tuple[str, ...]
    cloud: Cloud | None
    injectors: tuple[Injector, ...] = ()


def nearest_time(source: str, times: Iterable[float], wanted: float | None) -> float:
    """The time asked for, or the latest.

    Args:
        source: named by errors.
        times: those that there are [s].
        wanted: None is the latest [s].

    Returns:
        One of `times`.

    Raises:
        SprayError: there is none, or none within `TIME_TOLERANCE`; the message lists what there is.
    """
    known = sorted(set(times))
    if not known:
        raise SprayError(f"{source}: holds no time with results")
    if wanted is None:
        return known[-1]
    best = min(known, key=lambda time: abs(time - wanted))
    if abs(best - wanted) > max(TIME_TOLERANCE * abs(wanted), 1e-15):
        shown = ", ".join(f"{time:g}" for time in known[:20]) + (", ..." if known[20:] else "")
        raise SprayError(f"{source}: no time {wanted:g} s (spray.time_s); available: {shown}")
    return best


def choose_cloud(source: str, names: Iterable[str], wanted: str | None) -> str | None:
    """The cloud asked for, the only one, or None where there is none and none was asked for.

    Args:
        source: named by errors.
        names: of the clouds that there are.
        wanted: None is the only one.

    Returns:
        A name; None where there is no cloud and none was asked for.

    Raises:
        SprayError: there are several, or none of that name.
    """
    known = sorted(set(names))
    shown = ", ".join(known) or "none"
    if wanted is not None:
        if wanted not in known:
            raise SprayError(f"{source}: no cloud {wanted!r} (spray.cloud); available: {shown}")
        return wanted
    if len(known) > 1:
        raise SprayError(f"{source}: holds several clouds, {shown}; set spray.cloud to one of them")
    return known[0] if known else None


def complete_cloud(
    name: str, source: str, position_m: Column, fields: Mapping[str, Column]
) -> Cloud:
    """The cloud, once it has parcels and all that a droplet needs.

    Args:
        name: of the cloud.
        source: named by errors.
        position_m: (N, 3).
        fields: (N,) or (N, 3) each, by OpenFOAM's names.

    Raises:
        SprayError: no parcel, a field is missing, or has another length than the positions.
    """
    count = len(position_m.values)
    if count == 0:
        raise SprayError(
            f"{position_m.label}: cloud {name!r} holds no parcel; choose another time "
            "(spray.time_s), or remove the cloud's folder for a case of gas alone"
        )
    for field in CLOUD_FIELDS:
        if field not in fields:
            known = ", ".join(sorted(fields)) or "none"
            raise SprayError(f"{source}: cloud {name!r} has no field {field!r}; it has: {known}")
    for column in fields.values():
        if len(column.values) != count:
            raise SprayError(f"{column.label}: {len(column.values)} values for {count} parcels")
    return Cloud(name, position_m, fields)


def joined(columns: list[Column]) -> Column:
    """One column of the parts of a decomposed case, under the label of the first."""
    if len(columns) == 1:
        return columns[0]
    label = f"{columns[0].label} and the other processors'"
    return Column(label, np.concatenate([column.values for column in columns]))
