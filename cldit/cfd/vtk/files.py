"""One time of VTK files: of foamToVTK, of ParaView, or alone."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import (
    NO_CLOUD,
    CfdCase,
    Cloud,
    Column,
    choose_cloud,
    joined,
    only_claimant,
)
from cldit.cfd.column_mapping import (
    PARCEL_NAMES,
    ColumnMap,
    Source,
    gas_columns,
    gas_names,
    mapped_cloud,
    with_components,
)
from cldit.cfd.mesh import join
from cldit.cfd.point_data import with_point_fields
from cldit.cfd.times import CaseTime, choose_time
from cldit.cfd.vtk.collections import Entry, without_step
from cldit.cfd.vtk.datasets import (
    Marked,
    cell_columns,
    corner_mean,
    dimension,
    geometry_of,
    load_vtk,
    point_columns,
    time_value,
    unmarked,
    vtk_mesh,
)
from cldit.cfd.vtk.layout import Layout, find_layout
from cldit.errors import SprayError

_TIME = re.compile(rb"\btime='([^']+)'")


@dataclass(frozen=True)
class _Step:
    """The data sets of one time, by what they are: files, and vtk's objects without ghosts."""

    time_s: float | None
    meshes: list[tuple[Path, Any]]
    clouds: dict[str, list[tuple[Path, Any]]]
    files: tuple[Path, ...]
    remarks: tuple[str, ...]


def read_vtk(
    path: Path, *, time_s: CaseTime | None, fuel_field: str, cloud: str | None, names: ColumnMap
) -> CfdCase:
    """Reads one time of VTK files.

    Args:
        path: a .vtu, .vtk, .pvtu, .vtm or .pvd file; a folder of such files; or what foamToVTK
            wrote (`CASE/VTK`, or any file in it: then the step that the file belongs to).
        time_s: the latest where None. Times come from .pvd and .series files, else from the
            comment or the `TimeValue` in the file.
        fuel_field: name of the fuel's mass fraction.
        cloud: name of the cloud; the only one where None.
        names: names of fields where they are not OpenFOAM's.

    Raises:
        SprayError: vtk is not installed; a file is missing or damaged; the time or the cloud is
            not there, or the cloud is empty; several files claim to be the same.
    """
    layout = find_layout(_existing(path))
    step = _step(path, layout, time_s, cloud)
    chosen = choose_cloud(str(path), step.clouds, cloud)
    if chosen is None and cloud != NO_CLOUD and layout.beside:
        shown = ", ".join(map(str, layout.beside))
        raise SprayError(
            f"{path}: holds no parcels, but there may be some beside it: {shown}; give the folder "
            f"as the case to read both, or spray.cloud: {NO_CLOUD} for gas alone"
        )
    parts = []
    remarks = list(step.remarks)
    available: set[str] = set()
    skipped = []
    for file, grid in step.meshes:
        cells = cell_columns(file, grid)
        points = point_columns(file, grid)[1]
        wanted = gas_names(names.cells, cells | points, fuel_field)
        cells, moved = with_point_fields(cells, points, wanted, corner_mean(grid))
        available |= set(cells)
        if wanted.fuel is None and len(step.meshes) > 1:
            skipped.append(file)
            continue
        if moved:
            remarks.append(f"{file}: {', '.join(moved)} at points became means over cells.")
        mesh = vtk_mesh(file, grid)
        source = Source(str(file), cells, mesh.cells)
        parts.append((mesh, gas_columns(source, wanted, fuel_field)))
    if not parts:
        raise SprayError(f"{path}: no mesh has the cell field {fuel_field!r} (spray.fuel_field)")
    if skipped:
        shown = ", ".join(map(str, skipped))
        remarks.append(f"Meshes without {fuel_field} are left out: {shown}.")
    first = parts[0][1]
    for _, gas in parts:
        if odd := set(first) ^ set(gas):
            raise SprayError(f"{path}: only some of its meshes have the field {min(odd)!r}")
    return CfdCase(
        source=str(step.meshes[0][0]),
        time_s=step.time_s,
        mesh=join([mesh for mesh, _ in parts]),
        gas={name: joined([gas[name] for _, gas in parts]) for name in first},
        available=tuple(sorted(available)),
        cloud=None if chosen is None else _cloud(chosen, step.clouds[chosen], names),
        files=step.files,
        remarks=tuple(remarks),
    )


def list_vtk(
    path: Path, time_s: CaseTime | None
) -> tuple[list[float], list[str], dict[str, list[str]]]:
    """Times, fields, and clouds with their fields, of `time_s` or the last step.

    Args:
        path: as `read_vtk` takes it.
        time_s: None is the latest.

    Returns:
        Times [s], fields of cells and points of the mesh, and the fields of each cloud.

    Raises:
        SprayError: there is no such file or time, or a file is damaged.
    """
    layout = find_layout(_existing(path))
    step = _step(path, layout, time_s, NO_CLOUD)
    known = [time for time in _times(layout).values() if time is not None]
    fields = {
        name
        for file, grid in step.meshes
        for name in (*cell_columns(file, grid), *point_columns(file, grid)[1])
    }
    clouds = {
        name: sorted({key for file, data in parts for key in point_columns(file, data)[1]})
        for name, parts in step.clouds.items()
    }
    return known, sorted(fields), clouds


def _existing(path: Path) -> Path:
    if not path.exists():
        raise SprayError(f"{path}: no such file or folder (spray.file)")
    return path.resolve()


def _times(layout: Layout) -> dict[str, float | None]:
    """The time of each step that may hold a mesh."""
    steps = {
        key: found
        for key, found in layout.steps.items()
        if (layout.own is None or key == layout.own) and not all(entry.cloud for entry in found)
    }
    return {
        key: layout.times[key] if key in layout.times else _own_time(found)
        for key, found in steps.items()
    }


def _step(path: Path, layout: Layout, time_s: CaseTime | None, cloud: str | None) -> _Step:
    """The step at a time, its data sets read and sorted."""
    times = _times(layout)
    if not times:
        raise SprayError(
            f"{path}: no mesh in it: neither an OpenFOAM case (constant/polyMesh) nor VTK files "
            "(internal.vtu, .vtu, .pvtu, .vtm, .pvd or .vtk), EnSight (.case), CONVERGE (.h5) or a "
            "mapping file (.yaml)"
        )
    known = {time: key for key, time in times.items() if time is not None}
    if len(known) < len([time for time in times.values() if time is not None]):
        twice = next(t for t in known if list(times.values()).count(t) > 1)
        both = [key for key, time in times.items() if time == twice]
        only_claimant(
            f"time {twice:g}", (entry.pieces[0] for key in both for entry in layout.steps[key])
        )
    if len(known) == len(times):
        at: float | None = choose_time(str(path), known, time_s)
        key = known[choose_time(str(path), known, time_s)]
    elif len(times) == 1 and time_s in (None, "latest"):
        at, key = None, next(iter(times))
    else:
        raise SprayError(
            f"{path}: some mesh files do not say their time; give the path of one, without "
            "spray.time_s"
        )
    found = layout.steps[key]
    elsewhere = {k for k, each in layout.steps.items() if any(map(_parcels_likely, each))}
    if cloud != NO_CLOUD and elsewhere and not any(map(_parcels_likely, found)):
        raise SprayError(
            f"{found[0].pieces[0]}: no cloud file of the same step {key!r}, but other steps have: "
            f"{', '.join(sorted(elsewhere))} (spray.cloud: {NO_CLOUD} for gas alone)"
        )
    return _sorted(at, found, layout)


def _parcels_likely(entry: Entry) -> bool:
    return entry.cloud is True or (entry.cloud is None and entry.pieces[0].suffix == ".vtp")


def _sorted(at: float | None, found: Sequence[Entry], layout: Layout) -> _Step:
    """Meshes, clouds and the rest among the data sets of a step."""
    meshes: dict[Entry, list[tuple[Path, Any]]] = {}
    clouds: dict[str, list[tuple[Path, Any]]] = {}
    claims: dict[str, list[Path]] = {}
    marked = Marked()
    files = list(layout.read)
    surfaces = list(layout.left_out)
    for entry in found:
        loaded = [(file, load_vtk(file)) for file in entry.pieces]
        pieces = [(file, unmarked(data, marked)) for file, data in loaded]
        files += [*entry.named_by, *entry.pieces]
        high = max(dimension(data) for _, data in pieces)
        if entry.cloud or (entry.cloud is None and high == 0):
            name = entry.name if entry.cloud else without_step(entry.name)
            claims.setdefault(name, []).append(entry.pieces[0])
            clouds[name] = pieces
        elif entry.cloud is False or high in (-1, 3):
            meshes[entry] = pieces
        else:
            surfaces += entry.pieces
    for name, places in claims.items():
        only_claimant(f"cloud {name!r}", places)
    for pieces in clouds.values():
        _all_different(pieces)
    tops = {entry.named_by[:1] for entry in meshes}  # the blocks of one collection belong together
    if len(tops) > 1 or (len(meshes) > 1 and tops == {()}):
        only_claimant("the mesh of the gas", (entry.pieces[0] for entry in meshes))
    _all_different([piece for pieces in meshes.values() for piece in pieces])
    if not meshes:
        first = found[0].pieces[0]
        data = load_vtk(first, "vtkUnstructuredGrid")
        vtk_mesh(first, data)  # says which cells it has instead
        raise SprayError(f"{first}: holds parcels alone; name the gas, or the folder of both")
    remarks = marked.remarks
    if surfaces:
        shown = ", ".join(map(str, surfaces))
        remarks = (*remarks, f"Left out, neither gas nor parcels: {shown}.")
    every = [piece for pieces in meshes.values() for piece in pieces]
    for file, data in every:
        if not data.IsA("vtkUnstructuredGrid"):
            raise SprayError(f"{file}: holds {data.GetClassName()}, expected vtkUnstructuredGrid")
    return _Step(at, every, clouds, tuple(dict.fromkeys(files)), remarks)


def _all_different(parts: Sequence[tuple[Path, Any]]) -> None:
    """Refuses pieces that hold the same points and cells: they would count twice.

    Raises:
        SprayError: there are such; both are listed.
    """
    if len(parts) < 2:
        return
    seen: dict[bytes, Path] = {}
    for file, data in parts:
        if data.GetNumberOfPoints():
            key = hashlib.sha256()
            for array in geometry_of(data):
                key.update(np.ascontiguousarray(array).tobytes())
            only_claimant("the same piece of the data", {seen.setdefault(key.digest(), file), file})


def _cloud(name: str, parts: Sequence[tuple[Path, Any]], names: ColumnMap) -> Cloud:
    """The cloud of all its pieces; empty ones add nothing."""
    read = [point_columns(file, data) for file, data in parts]
    filled = [part for part in read if len(part[0].values)] or read[:1]
    fields = set.intersection(*(set(columns) for _, columns in filled))
    columns: dict[str, Column] = {
        key: joined([part[1][key] for part in filled]) for key in sorted(fields)
    }
    position = joined([part[0] for part in filled])
    file = str(parts[0][0])
    return mapped_cloud(name, file, position, with_components(columns), names, PARCEL_NAMES)


def _own_time(found: Sequence[Entry]) -> float | None:
    """The time that a file of a step states in its comment, or as the field `TimeValue`."""
    for file in (entry.pieces[0] for entry in found if not entry.cloud):
        with file.open("rb") as stream:
            comment = _TIME.search(stream.read(2000))
        if comment is None:
            time = time_value(load_vtk(file))
            if time is not None:
                return time
            continue
        try:
            return float(comment.group(1))
        except ValueError as error:
            raise SprayError(f"{file}: states the time {comment.group(1)!r}") from error
    return None
