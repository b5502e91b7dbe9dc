"""Step of VTK files at a time: its data sets, sorted into meshes and clouds."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cldit.cfd.case import NO_CLOUD, only_claimant
from cldit.cfd.hdf.arrays import hdf_files
from cldit.cfd.times import CaseTime, choose_time
from cldit.cfd.vtk.collections import Entry, without_step
from cldit.cfd.vtk.composite import COMPOSITE
from cldit.cfd.vtk.datasets import dimension, time_value
from cldit.cfd.vtk.ghosts import Marked, without_ghosts
from cldit.cfd.vtk.layout import Layout
from cldit.cfd.vtk.parcel_cells import parcels_of
from cldit.cfd.vtk.reading import Choose, Loaded, load_composite, load_vtk, nothing
from cldit.errors import NotAtThisTime, SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch, silent

_TIME = re.compile(rb"\btime='([^']+)'")


@dataclass(frozen=True)
class Step:
    """Data sets of one time, sorted by kind, without ghosts."""

    time_s: float | None
    meshes: list[Loaded]
    clouds: dict[str, list[Loaded]]
    files: tuple[Path, ...]
    remarks: tuple[str, ...]


class Loader:
    """Reads files; one that was read for its time, and is the only step, is not read again."""

    def __init__(self, choose: Choose, watch: Watch = silent) -> None:
        """`choose`: selects the fields of a mesh; `watch`: receives the progress."""
        self._choose, self._watch = choose, watch
        self._kept: dict[Path, Loaded] = {}

    def load(self, file: Path, *, whole: bool = False) -> Loaded:
        """Data set in a file; `whole` with all its fields."""
        kept = self._kept.pop(file, None)
        return kept or load_vtk(file, choose=None if whole else self._choose, watch=self._watch)

    def parts(self, entry: Entry) -> dict[Entry, list[Loaded]]:
        """Data sets of an entry with their pieces: several if its file holds several."""
        file = entry.pieces[0]
        if file.suffix not in COMPOSITE:
            whole = entry.cloud is True
            return {entry: [self.load(each, whole=whole) for each in entry.pieces]}
        found: dict[Entry, list[Loaded]] = {}
        at, watch = entry.time_s, self._watch
        for part in load_composite(file, choose=self._choose, time_s=at, watch=watch):
            named_by = entry.named_by or (file,)  # the blocks of a file belong together
            own = replace(entry, name=part.name or entry.name, named_by=named_by)
            found.setdefault(own, []).append(part)
        return found

    def time_in(self, file: Path, *, only: bool) -> float | None:
        """Field `TimeValue` in a file; `only`: the only step, which is read in any case."""
        if file.suffix in COMPOSITE:
            parts = load_composite(file, choose=nothing, time_s=None)
            return next((t for part in parts if (t := time_value(part.data)) is not None), None)
        if not only:
            return time_value(load_vtk(file, choose=nothing).data)
        self._kept[file] = self.load(file)
        return time_value(self._kept[file].data)


def step_times(layout: Layout, loader: Loader) -> dict[str, float | None]:
    """Time of each step of `layout` that may hold a mesh, by its key."""
    steps = {
        key: found
        for key, found in layout.steps.items()
        if (layout.own is None or key == layout.own) and not all(entry.cloud for entry in found)
    }
    only = len(steps) == 1
    known = layout.times
    return {k: known[k] if k in known else _own_time(e, loader, only) for k, e in steps.items()}


def find_step(
    path: Path,
    layout: Layout,
    loader: Loader,
    *,
    time_s: CaseTime | None,
    cloud: str | None,
    drops: Sequence[str],
) -> Step:
    """Step at a time, its data sets read and sorted; `cloud` is `none` for gas alone.

    drops: fields that mark lines and points as parcels, their size and number.
    """
    times = step_times(layout, loader)
    if not times:
        raise SprayError(
            f"{path}: no mesh in it: neither an OpenFOAM case (constant/polyMesh) nor VTK files "
            "(internal.vtu, .vtu, .pvtu, .vtm, .pvd or .vtk), nor another case that is read"
        )
    known: dict[float, str] = {}
    for key, time in times.items():
        if time is not None and (other := known.setdefault(time, key)) != key:
            both = (*layout.steps[other], *layout.steps[key])
            only_claimant(f"time {time:g}", (entry.pieces[0] for entry in both))
    if len(known) == len(times):
        missing = [each for each in layout.listed if each.step not in times]
        absent = {each.time_s: each for each in missing if layout.own is None}
        chosen = choose_time(str(path), [*known, *absent], time_s)
        if chosen not in known:
            there = ", ".join(f"{time:g}" for time in sorted(known)[-5:])
            raise SprayError(
                f"{absent[chosen].text}, and its mesh is missing; restore it, or choose of: {there}"
            )
        at: float | None = chosen
        key = known[chosen]
    elif len(times) == 1 and time_s in (None, "latest"):
        at, key = None, next(iter(times))
    else:
        what = "several mesh files, and not all state their time"
        steps = "if they are steps, give the path of one, without spray.time_s"
        pieces = "if they are pieces of one state, name all of them in a .pvtu and give its path"
        raise SprayError(f"{path}: {what}; {steps}; {pieces}")
    found = layout.steps[key]
    for each in layout.listed if cloud != NO_CLOUD else ():
        if each.step == key and each.of_cloud and not each.file.exists():
            raise SprayError(f"{each.text}, whose file {each.file.name} is missing")
    elsewhere = {k for k, each in layout.steps.items() if any(map(_parcels_likely, each))}
    if cloud != NO_CLOUD and elsewhere and not any(map(_parcels_likely, found)):
        others = f"{', '.join(sorted(elsewhere))} (spray.cloud: {NO_CLOUD} for gas alone)"
        what = f"no cloud file of the same step {key!r}, but other steps have"
        raise NotAtThisTime(f"{found[0].pieces[0]}: {what}: {others}")
    return _sorted(at, found, layout, loader, cloud, drops)


def _parcels_likely(entry: Entry) -> bool:
    return entry.cloud is True or (entry.cloud is None and entry.pieces[0].suffix == ".vtp")


def _sorted(
    at: float | None,
    found: Sequence[Entry],
    layout: Layout,
    loader: Loader,
    cloud: str | None,
    drops: Sequence[str],
) -> Step:
    """Sorts the data sets of a step into meshes, clouds and the rest."""
    meshes: dict[Entry, list[Loaded]] = {}
    clouds: dict[str, list[Loaded]] = {}
    claims: dict[str, list[Path]] = {}
    marked = Marked()
    files = list(layout.read)
    surfaces = list(layout.left_out)
    for entry, loaded in (pair for each in found for pair in loader.parts(each).items()):
        kept = without_ghosts([each.data for each in loaded], marked)
        pieces = [replace(each, data=data) for each, data in zip(loaded, kept, strict=True)]
        files += entry.named_by
        for piece in entry.pieces:
            files += hdf_files(piece) if piece.suffix in COMPOSITE else (piece,)
        high = max(dimension(piece.data) for piece in pieces)
        names = frozenset[str]().union(*(each.point_names | each.cell_names for each in pieces))
        name = entry.name if entry.cloud else without_step(entry.name)
        flat = all(piece.data.IsA("vtkPolyData") for piece in pieces)
        empty = high == -1 and flat and (not names or names.issuperset(drops))
        likely = high in (1, 2) and names.issuperset(drops) and cloud in (None, NO_CLOUD, name)
        if entry.cloud or (entry.cloud is None and (high == 0 or likely or empty)):
            claims.setdefault(name, []).append(entry.pieces[0])
            if cloud != NO_CLOUD:
                pieces = [parcels_of(piece, drops) for piece in pieces]
            clouds[name] = pieces
        elif high in (-1, 3):
            meshes[entry] = pieces
        else:
            surfaces += entry.pieces
    for name, places in claims.items():
        only_claimant(f"cloud {name!r}", places)
    tops = {entry.named_by[:1] for entry in meshes}  # the blocks of one collection belong together
    if len(tops) > 1 or (len(meshes) > 1 and tops == {()}):
        only_claimant("the mesh of the gas", (entry.pieces[0] for entry in meshes))
    every = [piece for pieces in meshes.values() for piece in pieces]
    shown = ", ".join(map(str, surfaces))
    if not meshes:
        parcels = ", ".join(str(each) for places in claims.values() for each in places)
        looked = (("parcels alone", parcels), ("lines or surfaces", shown))
        held = "; ".join(f"{what} in {names}" for what, names in looked if names)
        raise SprayError(
            f"{found[0].pieces[0].parent}: no gas: no data set of cells with a volume ({held}); "
            "name the gas, or the folder of gas and parcels"
        )
    remarks = (*layout.remarks, *marked.remarks)
    if surfaces:
        remarks = (*remarks, f"Omitted, neither gas nor parcels: {shown}.")
    return Step(at, every, clouds, tuple(dict.fromkeys(files)), remarks)


def _own_time(found: Sequence[Entry], loader: Loader, only: bool) -> float | None:
    """Time that a file of a step states in its comment, or as the field `TimeValue`."""
    for file in (entry.pieces[0] for entry in found if not entry.cloud):
        time = comment_time(file)
        time = loader.time_in(file, only=only) if time is None else time
        if time is not None:
            return time
    return None


def comment_time(file: Path) -> float | None:
    """Time that a file states in its comment."""
    with open_regular(file) as stream:
        comment = _TIME.search(stream.read(2000))
    try:
        return None if comment is None else float(comment.group(1))
    except ValueError as error:
        assert comment is not None
        raise SprayError(f"{file}: states the time {comment.group(1)!r}") from error
