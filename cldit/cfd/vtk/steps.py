"""Step of VTK files at a time: its data sets, without ghosts, sorted into meshes and clouds."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.cfd.case import NO_CLOUD, CaseTime, choose_time, only_claimant
from cldit.cfd.hdf.arrays import hdf_files
from cldit.cfd.mesh.cells import Labels
from cldit.cfd.one_state import hashes
from cldit.cfd.tolerances import ROUNDED
from cldit.cfd.vtk.collections import Entry, without_step
from cldit.cfd.vtk.composite import COMPOSITE
from cldit.cfd.vtk.datasets import GHOSTS, as_numpy, cell_lists, dimension, points_of, time_value
from cldit.cfd.vtk.layout import Layout
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

    def load(self, file: Path, *, complete: bool = False) -> Loaded:
        """Data set in a file, with all its fields if `complete`."""
        kept = self._kept.pop(file, None)
        return kept or load_vtk(file, choose=None if complete else self._choose, watch=self._watch)

    def parts(self, entry: Entry) -> dict[Entry, list[Loaded]]:
        """Data sets of an entry with their pieces: several if its file holds several."""
        file = entry.pieces[0]
        if file.suffix not in COMPOSITE:
            complete = entry.cloud is True
            return {entry: [self.load(piece, complete=complete) for piece in entry.pieces]}
        by_entry: dict[Entry, list[Loaded]] = {}
        at, watch = entry.time_s, self._watch
        for part in load_composite(file, choose=self._choose, time_s=at, watch=watch):
            named_by = entry.named_by or (file,)  # the blocks of a file belong together
            part_entry = replace(entry, name=part.name or entry.name, named_by=named_by)
            by_entry.setdefault(part_entry, []).append(part)
        return by_entry

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
        key: group
        for key, group in layout.steps.items()
        if layout.named_step in (None, key) and not all(entry.cloud for entry in group)
    }
    only = len(steps) == 1
    stated = layout.times
    return {k: stated[k] if k in stated else _own_time(e, loader, only) for k, e in steps.items()}


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
    by_time: dict[float, str] = {}
    for key, time in times.items():
        if time is not None and (rival := by_time.setdefault(time, key)) != key:
            claims = (*layout.steps[rival], *layout.steps[key])
            only_claimant(f"time {time:g}", (entry.pieces[0] for entry in claims))
    if len(by_time) == len(times):
        absent = {
            time: f"{file}: lists step {step} ({time:g} s)"
            for file, items in layout.listed.items()
            for step, time, _ in items
            if step not in times and layout.named_step is None
        }
        chosen = choose_time(str(path), [*by_time, *absent], time_s)
        if chosen not in by_time:
            shown = ", ".join(f"{time:g}" for time in sorted(by_time)[-5:])
            raise SprayError(
                f"{absent[chosen]}, and its mesh is missing; restore it, or choose of: {shown}"
            )
        at: float | None = chosen
        key = by_time[chosen]
    elif len(times) == 1 and time_s in (None, "latest"):
        at, key = None, next(iter(times))
    else:
        problem = "several mesh files, and not all state their time"
        steps = "if they are steps, give the path of one, without spray.time_s"
        pieces = "if they are pieces of one state, name all of them in a .pvtu and give its path"
        raise SprayError(f"{path}: {problem}; {steps}; {pieces}")
    data_sets = layout.steps[key]
    clouds = [file for file in layout.listed if "lagrangian" in file.parts and cloud != NO_CLOUD]
    for listing_file, (step, time, inside) in (
        (file, item) for file in clouds for item in layout.listed[file]
    ):
        if step == key and not inside.exists():
            listing = f"{listing_file}: lists step {step} ({time:g} s)"
            raise SprayError(f"{listing}, whose file {inside.name} is missing")
    elsewhere = {k for k, group in layout.steps.items() if any(map(_parcels_likely, group))}
    if cloud != NO_CLOUD and elsewhere and not any(map(_parcels_likely, data_sets)):
        hint = f"{', '.join(sorted(elsewhere))} (spray.cloud: {NO_CLOUD} for gas alone)"
        problem = f"no cloud file of the same step {key!r}, but other steps have"
        raise NotAtThisTime(f"{data_sets[0].pieces[0]}: {problem}: {hint}")
    return _sorted(at, data_sets, layout, loader, cloud, drops)


def _parcels_likely(entry: Entry) -> bool:
    return entry.cloud is True or (entry.cloud is None and entry.pieces[0].suffix == ".vtp")


def _sorted(
    at: float | None,
    group: Sequence[Entry],
    layout: Layout,
    loader: Loader,
    cloud: str | None,
    drops: Sequence[str],
) -> Step:
    """Sorts the data sets of a step into meshes, clouds and the rest."""
    meshes: dict[Entry, list[Loaded]] = {}
    clouds: dict[str, list[Loaded]] = {}
    claims: dict[str, list[Path]] = {}
    marked: Counter[str] = Counter()
    files = list(layout.read)
    surfaces = list(layout.left_out)
    for entry, loaded in (pair for item in group for pair in loader.parts(item).items()):
        kept = without_ghosts([part.data for part in loaded], marked)
        pieces = [replace(part, data=data) for part, data in zip(loaded, kept, strict=True)]
        files += entry.named_by
        for piece in entry.pieces:
            files += hdf_files(piece) if piece.suffix in COMPOSITE else (piece,)
        high = max(dimension(piece.data) for piece in pieces)
        names = frozenset[str]().union(*(part.point_names | part.cell_names for part in pieces))
        name = entry.name if entry.cloud else without_step(entry.name)
        flat = all(piece.data.IsA("vtkPolyData") for piece in pieces)
        empty = high == -1 and flat and (not names or names.issuperset(drops))
        likely = high in (1, 2) and names.issuperset(drops) and cloud in (None, NO_CLOUD, name)
        if entry.cloud or (entry.cloud is None and (high == 0 or likely or empty)):
            claims.setdefault(name, []).append(entry.pieces[0])
            if cloud != NO_CLOUD:
                pieces = [_parcels_of(piece, drops) for piece in pieces]
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
    gas = [piece for pieces in meshes.values() for piece in pieces]
    shown = ", ".join(map(str, surfaces))
    if not meshes:
        parcels = ", ".join(str(place) for places in claims.values() for place in places)
        looked = (("parcels alone", parcels), ("lines or surfaces", shown))
        held = "; ".join(f"{kind} in {names}" for kind, names in looked if names)
        raise SprayError(
            f"{group[0].pieces[0].parent}: no gas: no data set of cells with a volume ({held}); "
            "name the gas, or the folder of gas and parcels"
        )
    remarks = (*layout.remarks, *ghost_remarks(marked))
    if surfaces:
        remarks = (*remarks, f"Omitted, neither gas nor parcels: {shown}.")
    return Step(at, gas, clouds, tuple(dict.fromkeys(files)), remarks)


def _own_time(data_sets: Sequence[Entry], loader: Loader, only: bool) -> float | None:
    """Time that a file of a step states in its comment, or as the field `TimeValue`."""
    for file in (entry.pieces[0] for entry in data_sets if not entry.cloud):
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


def _parcels_of(piece: Loaded, drops: Sequence[str]) -> Loaded:
    """Points with the fields of parcels, which may belong to vertices as cells.

    drops: fields that mark parcels, of their size and number; none for a cloud that is named.
    Lines that join parcels of one time are ignored; those that follow single parcels, and
    surfaces, such as glyphs, are refused.
    """
    data = piece.data
    in_cells = set(drops) <= piece.cell_names and not set(drops) <= piece.point_names
    if not drops or (dimension(data) <= 0 and not in_cells):
        return piece
    nodes, start = cell_lists(data)
    if dimension(data) == 2 or (in_cells and np.any(np.diff(start) != 1)):
        raise _refusal(piece, drops, "on lines or surfaces, such as glyphs")
    if not in_cells:
        if _follow_parcels(piece, drops[-1], nodes, start):
            raise _refusal(piece, drops, "on lines along which a parcel keeps its number: tracks")
        return replace(piece, data=as_points(data, np.arange(data.GetNumberOfPoints())))
    points = as_points(data, nodes)
    points.GetPointData().ShallowCopy(data.GetCellData())
    return replace(piece, data=points, point_names=piece.cell_names)


def _follow_parcels(piece: Loaded, number: str, nodes: Labels, start: Labels) -> bool:
    """True if numbers or masses stay or fall, and ages only rise or only fall, along all lines."""
    inside = np.ones(len(nodes), dtype=bool)
    inside[start[:-1][np.diff(start) > 0]] = False  # the first point of a line
    later = np.flatnonzero(inside)

    def steps(name: str) -> Floats:
        values = as_numpy(piece.data.GetPointData().GetArray(name)).astype(np.float64)
        return np.asarray(values[nodes[later]] - values[nodes[later - 1]])

    if not len(later) or np.any(steps(number) > 0):
        return False
    ages = steps("age") if "age" in piece.point_names else np.zeros(1)
    return bool(np.all(ages >= 0) or np.all(ages <= 0))


def _refusal(piece: Loaded, drops: Sequence[str], where: str) -> SprayError:
    return SprayError(
        f"{piece.file}: has {' and '.join(drops)}, the fields of parcels, {where}; save the "
        "points of one time as vertices, or name the cloud to be read (spray.cloud; "
        f"{NO_CLOUD} for gas alone)"
    )


def ghost_remarks(marked: Counter[str]) -> tuple[str, ...]:
    """Sentences on the cells and points that `without_ghosts` omitted or kept."""
    counts = [f"{marked[kind]} {kind}" for kind in ("cells", "points") if marked[kind]]
    lines = [f"Marked as ghost or hidden, omitted: {' and '.join(counts)}."] if counts else []
    if marked["kept"]:
        lines.append(f"Marked as ghost in every piece, kept once: {marked['kept']}.")
    return tuple(lines)


def without_ghosts(pieces: Sequence[Any], marked: Counter[str]) -> list[Any]:
    """Pieces of a data set without the cells and parcels that `vtkGhostType` marks.

    Adds their numbers to `marked`: of `cells` and `points` that were omitted, and of copies that
    were `kept`. A copy that is marked in every piece is kept once. Points of a mesh are kept, as
    cells refer to them. Points of a set without cells of three dimensions are parcels.
    """
    bits = [_bits(data) for data in pieces]
    spared = [np.zeros(len(marks), dtype=bool) for marks in bits]
    if sum(bool(np.any(marks == 1)) for marks in bits) > 1:
        spared = _owned_by_none([_places(data) for data in pieces], bits)
        marked["kept"] += sum(int(mask.sum()) for mask in spared)
    cleaned = []
    for data, marks, saved in zip(pieces, bits, spared, strict=True):
        bad = (marks != 0) & ~saved
        if not bad.any():
            cleaned.append(data)
        elif dimension(data) > 0:
            marked["cells"] += int(bad.sum())
            cleaned.append(_cells_of(data, np.flatnonzero(~bad)))
        else:
            marked["points"] += int(bad.sum())
            cleaned.append(as_points(data, np.flatnonzero(~bad)))
    return cleaned


def _bits(data: Any) -> NDArray[np.integer]:
    """Marks of the cells, or of the parcels of a set of points."""
    from vtkmodules.vtkCommonDataModel import vtkDataSetAttributes as Bits

    cell_bits = Bits.DUPLICATECELL | Bits.REFINEDCELL | Bits.EXTERIORCELL | Bits.HIDDENCELL
    point_bits = Bits.DUPLICATEPOINT | Bits.HIDDENPOINT
    in_cells, at_points = data.GetCellData().GetArray(GHOSTS), data.GetPointData().GetArray(GHOSTS)
    if dimension(data) > 0:
        none = np.zeros(data.GetNumberOfCells(), np.uint8)
        return none if in_cells is None else as_numpy(in_cells) & cell_bits
    marks = np.zeros(data.GetNumberOfPoints(), np.uint8)
    if at_points is not None:
        marks |= as_numpy(at_points) & point_bits
    if in_cells is not None and data.GetNumberOfCells() == len(marks):  # vertices
        marks |= as_numpy(in_cells) & cell_bits
    return marks


def _places(data: Any) -> Floats:
    """Means of the corners of the cells, or the points themselves, (N, 3)."""
    points: Floats = points_of(data).astype(np.float64)
    if dimension(data) <= 0:
        return points
    nodes, start = cell_lists(data)
    sums = np.add.reduceat(points[nodes], start[:-1], axis=0)
    return np.asarray(sums / np.diff(start)[:, None])


def _owned_by_none(places: Sequence[Floats], bits: Sequence[NDArray[np.integer]]) -> list[Mask]:
    """First of the copies at each place at which several are and no entry is unmarked."""
    points, marks = np.concatenate(list(places)), np.concatenate(list(bits))
    step = ROUNDED * max(float(np.ptp(points, axis=0).max()), 1e-12)
    key = hashes(np.floor(points / step + np.sqrt(0.5)))
    copies = np.flatnonzero(marks == 1)
    keys, index, count = np.unique(key[copies], return_index=True, return_counts=True)
    kept = copies[index[(count > 1) & ~np.isin(keys, key[marks == 0])]]
    spared = np.zeros(len(marks), dtype=bool)
    spared[kept] = True
    return np.split(spared, np.cumsum([len(part) for part in bits])[:-1])


def _cells_of(data: Any, kept: Any) -> Any:
    """Some cells of a data set, with their data, in order."""
    from vtkmodules.vtkFiltersCore import vtkExtractCells

    extract = vtkExtractCells()
    extract.SetInputData(data)
    extract.SetCellList(_id_list(kept))
    extract.Update()
    return extract.GetOutput()


def as_points(data: Any, kept: Any) -> Any:
    """Some points of a data set, with their data, in order, without cells."""
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    chosen = _id_list(kept)
    cloud: Any = vtkPolyData()
    points: Any = vtkPoints()
    points.SetDataType(data.GetPoints().GetDataType())
    data.GetPoints().GetPoints(chosen, points)
    cloud.SetPoints(points)
    cloud.GetPointData().CopyAllocate(data.GetPointData(), len(kept))
    cloud.GetPointData().SetNumberOfTuples(len(kept))
    cloud.GetPointData().CopyData(data.GetPointData(), chosen, 0)
    return cloud


def _id_list(kept: Any) -> Any:
    from vtkmodules.vtkCommonCore import vtkIdList

    chosen = vtkIdList()
    chosen.SetNumberOfIds(len(kept))
    for place, index in enumerate(kept.tolist()):
        chosen.SetId(place, index)
    return chosen
