"""Cells and parcels that `vtkGhostType` marks as copies of another piece's, or as hidden."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.cfd.one_state import hashes
from cldit.cfd.tolerances import ROUNDED
from cldit.cfd.vtk.datasets import GHOSTS, as_numpy, cell_lists, dimension, points_of


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
