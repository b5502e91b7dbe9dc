"""Cells and parcels that a vtk file marks as copied or hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.cfd.vtk.datasets import GHOSTS, as_numpy, dimension

# bits of the array vtkGhostType (vtkDataSetAttributes): a copy of another piece's cell, a cell that
# finer ones replace, one outside, one that is hidden; a copied and a hidden point
_MARKED_CELL = 1 | 8 | 16 | 32
_MARKED_POINT = 1 | 2


@dataclass
class Marked:
    """How many cells and points were marked as copied or hidden, and left out."""

    cells: int = 0
    points: int = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """A sentence, where there were any."""
        pairs = ((self.cells, "cells"), (self.points, "points"))
        counts = [f"{count} {what}" for count, what in pairs if count]
        return (f"Marked as ghost or hidden, left out: {' and '.join(counts)}.",) if counts else ()


def unmarked(data: Any, marked: Marked) -> Any:
    """The data set without cells and parcels that `vtkGhostType` marks; they are counted.

    Points of a mesh are kept: cells name them. The points of a set without cells of three
    dimensions are parcels.

    Args:
        data: vtk's.
        marked: counts them.
    """
    if dimension(data) > 0:
        ghosts = data.GetCellData().GetArray(GHOSTS)
        if ghosts is None or not (bad := (as_numpy(ghosts) & _MARKED_CELL) != 0).any():
            return data
        marked.cells += int(bad.sum())
        return _cells_of(data, np.flatnonzero(~bad))
    bad = np.zeros(data.GetNumberOfPoints(), dtype=bool)
    ghosts = data.GetPointData().GetArray(GHOSTS)
    if ghosts is not None:
        bad |= (as_numpy(ghosts) & _MARKED_POINT) != 0
    ghosts = data.GetCellData().GetArray(GHOSTS)
    if ghosts is not None and data.GetNumberOfCells() == len(bad):  # a vertex a parcel, in order
        bad |= (as_numpy(ghosts) & _MARKED_CELL) != 0
    if not bad.any():
        return data
    marked.points += int(bad.sum())
    return _points_of(data, np.flatnonzero(~bad))


def _cells_of(data: Any, kept: Any) -> Any:
    """Some cells of a data set, with their data, in order."""
    from vtkmodules.vtkFiltersCore import vtkExtractCells

    extract = vtkExtractCells()
    extract.SetInputData(data)
    extract.SetCellList(_id_list(kept))
    extract.Update()
    return extract.GetOutput()


def _points_of(data: Any, kept: Any) -> Any:
    """Some points of a data set, with their data, in order."""
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    chosen = _id_list(kept)
    found: Any = vtkPolyData()
    points: Any = vtkPoints()
    points.SetDataType(data.GetPoints().GetDataType())
    data.GetPoints().GetPoints(chosen, points)
    found.SetPoints(points)
    found.GetPointData().CopyAllocate(data.GetPointData(), len(kept))
    found.GetPointData().SetNumberOfTuples(len(kept))
    found.GetPointData().CopyData(data.GetPointData(), chosen, 0)
    return found


def _id_list(kept: Any) -> Any:
    from vtkmodules.vtkCommonCore import vtkIdList

    chosen = vtkIdList()
    chosen.SetNumberOfIds(len(kept))
    for place, index in enumerate(kept.tolist()):
        chosen.SetId(place, index)
    return chosen
