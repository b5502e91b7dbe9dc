"""CFD case as a reader returns it, in its own coordinates, and choices among times and clouds."""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.cfd.mesh.cells import AnyFloats, CellMesh
from cldit.cfd.tolerances import ROUNDED
from cldit.errors import EmptyCloud, SprayError
from cldit.scene.spray import CfdSpray

CLOUD_FIELDS = ("d", "nParticle", "T", "rho")
NO_CLOUD = "none"  # name of a cloud by which a user asks for gas alone
Listing = tuple[list[float], list[str], dict[str, list[str]]]
"""Times [s], cell fields, and clouds with their fields, of a case."""


@dataclass(frozen=True)
class Column:
    """Values (N,) or (N, 3), and the label (file and field) that errors name.

    undefined: (N,), true where the file marks a value as undefined; None: all are defined.
    unit: what the file states, as mapping files spell it; None: nothing.
    """

    label: str
    values: AnyFloats
    undefined: Mask | None = None
    unit: str | None = None

    def outside(self, low: float, high: float) -> Mask | None:
        """Mask (N,) of values that are no numbers within low..high; None if there are none."""
        values = self.values
        if values.ndim != 1:
            raise SprayError(f"{self.label}: shape {values.shape}, expected one number an entry")
        if values.size and values.min() >= low and values.max() <= high:  # false for NaN as well
            return None
        bad = ~((values >= low) & (values <= high))
        return bad if bad.any() else None


@dataclass(frozen=True)
class Cloud:
    """Parcels: positions (N, 3), fields by name: d, nParticle, T, rho; U, age, origin if given.

    extra: columns (N,) of the file that are none of these, as evidence of what the rows are.
    """

    name: str
    position_m: Column
    fields: Mapping[str, Column]
    extra: Mapping[str, Column] = field(default_factory=dict)

    @property
    def masses(self) -> AnyFloats:
        """Masses of the parcels, (N,), up to the factor pi/6."""
        count, density, size = (self.fields[name].values for name in ("nParticle", "rho", "d"))
        return count * density * size**3


@dataclass(frozen=True)
class Injector:
    """Position and direction, (3,) each, of an injector in the dictionary `source`."""

    source: str
    position_m: Floats
    direction: Floats


@dataclass(frozen=True)
class Boundary:
    """Patch at which the case is cut, such as a wedge or a plane of symmetry.

    kind: OpenFOAM's type of the patch; normal: outwards, (3,); place_m: a point of it, (3,).
    """

    name: str
    kind: str
    normal: Floats
    place_m: Floats


@dataclass(frozen=True)
class CfdCase:
    """One time of a case: mesh, cell fields by name (N,), cloud, injectors; time_s if known.

    gas: the fields that were read; available: the names of all fields; boundaries: patches at which
    the case is cut; wall_K: wall temperature, if the case states it; files: all that were read;
    remarks: choices and omissions; times_s: the time that each of the files states in itself;
    accept: checks that scene or mapping file turn into remarks.
    """

    source: str
    time_s: float | None
    mesh: CellMesh
    gas: Mapping[str, Column]
    available: tuple[str, ...]
    cloud: Cloud | None
    injectors: tuple[Injector, ...] = ()
    boundaries: tuple[Boundary, ...] = ()
    wall_K: float | None = None
    files: tuple[Path, ...] = ()
    remarks: tuple[str, ...] = ()
    times_s: Mapping[Path, float] = field(default_factory=dict)
    accept: tuple[str, ...] = ()


def triple(vector: Floats) -> str:
    """Text of three numbers (3,); what rounding leaves of zero becomes zero."""
    return "(" + ", ".join(f"{0.0 if abs(part) < 1e-12 else part:.4g}" for part in vector) + ")"


def only_claimant(role: str, claimants: Iterable[Path]) -> Path:
    """Returns the only file in a `role` ("the mesh of step 10"); raises if several claim it."""
    distinct = sorted(set(claimants))
    if len(distinct) > 1:
        shown = ", ".join(map(str, distinct))
        way = "name one of them as the case, or move the others"
        raise SprayError(f"{distinct[0]}: {len(distinct)} claim to be {role}: {shown}; {way}")
    return distinct[0]


def choose_cloud(source: str, names: Iterable[str], requested: str | None) -> str | None:
    """Chooses the cloud asked for, else the only one; None for gas alone (`none`, or no cloud)."""
    if requested == NO_CLOUD:
        return None
    available = sorted(set(names))
    shown = ", ".join(available) or "none"
    if requested is not None:
        if requested not in available:
            raise SprayError(f"{source}: no cloud {requested!r} (spray.cloud); available: {shown}")
        return requested
    if len(available) > 1:
        way = f"set spray.cloud to one of them, or to {NO_CLOUD!r} for gas alone"
        raise SprayError(f"{source}: several clouds: {shown}; {way}")
    return available[0] if available else None


def refuse_cloud(spec: CfdSpray) -> None:
    """Refuses a cloud of a format that has none."""
    if spec.cloud not in (None, NO_CLOUD):
        way = "this format has no parcels; a mapping file names their table (parcels.file)"
        raise SprayError(f"{spec.file}: no cloud {spec.cloud!r} (spray.cloud): {way}")


def complete_cloud(
    name: str,
    source: str,
    position_m: Column,
    fields: Mapping[str, Column],
    columns: Mapping[str, Column],
    used: Container[str],
) -> Cloud:
    """Makes a cloud once it has parcels and every field that a droplet needs.

    `source` and `columns`, all of the file, are for errors; those that are not `used` and were
    read are kept.
    """
    count = len(position_m.values)
    if count == 0:
        way = f"choose another time (spray.time_s), or spray.cloud: {NO_CLOUD} for gas alone"
        raise EmptyCloud(f"{position_m.label}: cloud {name!r} has no parcel; {way}")
    for needed in CLOUD_FIELDS:
        if needed not in fields:
            available = ", ".join(sorted(columns)) or "none"
            lack = f"cloud {name!r} has no field {needed!r}"
            way = f"a mapping file names it{', or a constant: `density: 684`' * (needed == 'rho')}"
            raise SprayError(f"{source}: {lack}; it has: {available} ({way})")
    for column in fields.values():
        if len(column.values) != count:
            raise SprayError(f"{column.label}: {len(column.values)} values for {count} parcels")
    extra = {k: v for k, v in columns.items() if k not in used and v.values.shape == (count,)}
    return Cloud(name, position_m, fields, extra)


def joined(columns: list[Column]) -> Column:
    """Joins the parts of a decomposed case to one column with the label of the first."""
    if len(columns) == 1:
        return columns[0]
    label = f"{columns[0].label} and the other processors'"
    values = np.concatenate([column.values for column in columns])
    return Column(label, values, unit=columns[0].unit)


CaseTime = float | str  # a number, `latest`, or `nearest` and a number (cldit.scene.values)


def wanted_time(requested: CaseTime | None) -> tuple[float | None, bool]:
    """Splits a requested time: its number (None: the latest), and True if the nearest is enough."""
    if requested is None or requested == "latest":
        return None, False
    if isinstance(requested, str):
        return float(requested.removeprefix("nearest")), True
    return requested, False


def choose_time(source: str, times: Iterable[float], requested: CaseTime | None) -> float:
    """Returns the time asked for, else the latest; a number must match within `ROUNDED`."""
    steps = sorted(set(times))
    if not steps:
        raise SprayError(f"{source}: no time with results")
    number, nearest = wanted_time(requested)
    if number is None:
        return steps[-1]
    best = min(steps, key=lambda time: abs(time - number))
    if not nearest and abs(best - number) > max(ROUNDED * abs(number), 1e-15):
        shown = ", ".join(f"{time:.7g}" for time in steps[:20]) + (", ..." if steps[20:] else "")
        raise SprayError(
            f"{source}: no time {number:g} s (spray.time_s); available: {shown}; the nearest is "
            f"{abs(best - number):.3g} away: `nearest {number:g}` takes it"
        )
    return best


def choose_file(
    source: str, by_time: Mapping[float, Iterable[Path]], requested: CaseTime | None, role: str = ""
) -> tuple[float, Path]:
    """Returns `choose_time`, and the only file of that time in a `role`."""
    time = choose_time(source, by_time, requested)
    return time, only_claimant(f"{role}time {time:g}", by_time[time])


def stated_time(source: str, times: Iterable[float], requested: CaseTime | None) -> float | None:
    """Returns `choose_time` of the times that a case states; None if it states none."""
    steps = list(times)
    if not steps and requested not in (None, "latest"):
        raise SprayError(f"{source}: does not state its time; remove spray.time_s")
    return choose_time(source, steps, requested) if steps else None


def choose_times(
    source: str, times: Iterable[float], requested: str | Sequence[CaseTime]
) -> tuple[float, ...]:
    """Chooses several times, ascending, each once.

    `requested` is `all`; a slice of Python's over the sorted times (`::5`, `10:`, `-3:`); or single
    times, each as `choose_time` takes it.
    """
    steps = sorted(set(times))
    if isinstance(requested, str):
        selection = slice(None) if requested == "all" else _slice(source, requested)
        chosen = steps[selection]
    else:
        chosen = sorted({choose_time(source, steps, time) for time in requested})
    if not chosen:
        raise SprayError(f"{source}: {requested}: selects none of its {len(steps)} times")
    return tuple(chosen)


def _slice(source: str, selection: str) -> slice:
    parts = selection.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
        if len(parts) not in (2, 3) or numbers[2:] == [0]:
            raise ValueError
    except ValueError as error:
        raise SprayError(
            f"{source}: times {selection!r}; allowed: `all`, a list of times, or a slice such as "
            "`::5` (every fifth), `10:` or `-3:`"
        ) from error
    return slice(*numbers)


def time_remarks(taken: float | None, requested: CaseTime | None) -> tuple[str, ...]:
    """Remark on how far the nearest time, `taken`, is from the one asked for."""
    number, nearest = wanted_time(requested)
    if not nearest or number is None or taken is None or taken == number:
        return ()
    return (f"Time {taken:.9g} is the nearest to {number:.9g}: {abs(taken - number):.3g} away.",)
