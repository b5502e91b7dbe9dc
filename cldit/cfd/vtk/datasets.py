"""vtk data sets as NumPy arrays. vtk is imported only when a function is called."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.mesh.elements import ElementMesh, PolyhedronFaces
from cldit.errors import SprayError

GHOSTS = "vtkGhostType"  # name of the array that marks cells and points


def dimension(data: Any) -> int:
    """Largest dimension of its cells, 0 for points alone; -1 of an empty data set."""
    if not data.GetNumberOfCells():
        return 0 if data.GetNumberOfPoints() else -1
    if data.IsA("vtkPolyData"):
        surface = data.GetNumberOfPolys() or data.GetNumberOfStrips()
        return 2 if surface else int(data.GetNumberOfLines() > 0)
    if not data.IsA("vtkUnstructuredGrid"):
        return 3
    from vtkmodules.vtkCommonDataModel import vtkCellTypes

    found = vtkCellTypes()
    # the same method under its name from vtk 9.6 on, and before
    (getattr(data, "GetDistinctCellTypes", None) or data.GetCellTypes)(found)
    kinds = [found.GetCellType(place) for place in range(found.GetNumberOfTypes())]
    return max(_DIMENSION.get(kind, 3) for kind in kinds)


_DIMENSION = {1: 0, 2: 0, 3: 1, 4: 1, 21: 1} | dict.fromkeys((5, 6, 7, 8, 9, 22, 23, 28), 2)


def geometry_of(data: Any) -> tuple[Any, ...]:
    """Coordinates, and the corners of the cells of a grid."""
    grid = data.IsA("vtkUnstructuredGrid")
    return (_points(data), *((_lists(data.GetCells())[0],) if grid else ()))


def as_unstructured(data: Any) -> Any:
    """Converts an image, a rectilinear or a structured grid; other data sets are unchanged.

    A cell with a hidden corner is marked as hidden.
    """
    if not any(map(data.IsA, ("vtkImageData", "vtkRectilinearGrid", "vtkStructuredGrid"))):
        return data
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm
    from vtkmodules.vtkFiltersCore import vtkAppendFilter

    append = vtkAppendFilter()
    append.SetOutputPointsPrecision(vtkAlgorithm.DOUBLE_PRECISION)
    append.AddInputData(data)
    append.Update()
    grid: Any = append.GetOutput()
    hidden = grid.GetPointData().GetArray(GHOSTS)
    if hidden is not None and grid.GetNumberOfCells():
        corners = as_numpy(grid.GetCells().GetConnectivityArray())
        bad = ((as_numpy(hidden) & 2) != 0)[corners.reshape(grid.GetNumberOfCells(), -1)]
        marks = np.where(bad.any(axis=1), 32, 0).astype(np.uint8)
        ghosts = grid.GetCellData().GetArray(GHOSTS)
        make: Any = numpy_support.numpy_to_vtk
        found = make(marks if ghosts is None else marks | as_numpy(ghosts), deep=True)
        found.SetName(GHOSTS)
        grid.GetCellData().AddArray(found)
    return grid


def time_value(data: Any) -> float | None:
    """Field `TimeValue` that foamToVTK adds, if there is one."""
    values = data.GetFieldData().GetArray("TimeValue")
    return None if values is None or not values.GetNumberOfValues() else values.GetValue(0)


def cell_columns(file: Path, data: Any) -> dict[str, Column]:
    """Numeric cell arrays of `data` by name, as vtk holds them."""
    return _columns(file, data.GetCellData(), "cell field")


def point_columns(file: Path, data: Any) -> tuple[Column, dict[str, Column]]:
    """Positions (N, 3), and numeric point arrays of `data` by name, as doubles."""
    fields = _columns(file, data.GetPointData(), "point field")
    place = Column(f"{file}: points", _points(data).astype(np.float64))
    return place, {k: Column(v.label, v.values.astype(np.float64)) for k, v in fields.items()}


def as_numpy(array: Any) -> Any:
    """View of a vtk array in NumPy, without a copy."""
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return convert(array)


def _points(data: Any) -> Any:
    some = data.GetNumberOfPoints() > 0
    return as_numpy(data.GetPoints().GetData()) if some else np.empty((0, 3))


def _columns(file: Path, data: Any, kind: str) -> dict[str, Column]:
    arrays = [data.GetArray(index) for index in range(data.GetNumberOfArrays())]
    named = {each.GetName(): each for each in arrays if each is not None and each.GetName()}
    return {name: Column(f"{file}: {kind} {name}", as_numpy(each)) for name, each in named.items()}


def vtk_mesh(file: Path, grid: Any) -> ElementMesh:
    """Mesh of an unstructured `grid` of linear cells and polyhedra, on vtk's own arrays."""
    count = grid.GetNumberOfCells()
    if count == 0:
        raise SprayError(f"{file}: the mesh has no cell")
    if grid.IsHomogeneous():
        kinds = np.broadcast_to(np.uint8(grid.GetCellType(0)), count)
    else:
        try:
            types = grid.GetCellTypes()
        except TypeError:  # vtk before 9.6, where the name means another list
            types = grid.GetCellTypesArray()
        kinds = as_numpy(types)
    nodes, offsets = _lists(grid.GetCells())
    faces, own = grid.GetPolyhedronFaces(), grid.GetPolyhedronFaceLocations()
    solid = None
    if faces is not None and own is not None and own.GetNumberOfCells():
        solid = PolyhedronFaces(*_lists(faces), *_lists(own))
    return ElementMesh(_points(grid), kinds, offsets, nodes, str(file), solid)


def _lists(cells: Any) -> tuple[Any, Any]:
    """Content of all lists of a vtkCellArray, one after the other, and their offsets."""
    return as_numpy(cells.GetConnectivityArray()), as_numpy(cells.GetOffsetsArray())


# bits of the array vtkGhostType (vtkDataSetAttributes): a copy of another piece's cell, a cell that
# finer ones replace, one outside, one that is hidden; a copied and a hidden point
_MARKED_CELL = 1 | 8 | 16 | 32
_MARKED_POINT = 1 | 2


@dataclass
class Marked:
    """Numbers of cells and points that were marked as copied or hidden, and omitted."""

    cells: int = 0
    points: int = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentence on them, if there are any."""
        pairs = ((self.cells, "cells"), (self.points, "points"))
        counts = [f"{count} {what}" for count, what in pairs if count]
        return (f"Marked as ghost or hidden, omitted: {' and '.join(counts)}.",) if counts else ()


def unmarked(data: Any, marked: Marked) -> Any:
    """Removes cells and parcels that `vtkGhostType` marks, and counts them in `marked`.

    Points of a mesh are kept, as cells refer to them. Points of a set without cells of three
    dimensions are parcels.
    """
    in_cells, at_points = data.GetCellData().GetArray(GHOSTS), data.GetPointData().GetArray(GHOSTS)
    if dimension(data) > 0:
        if in_cells is None or not (bad := (as_numpy(in_cells) & _MARKED_CELL) != 0).any():
            return data
        marked.cells += int(bad.sum())
        return _cells_of(data, np.flatnonzero(~bad))
    bad = np.zeros(data.GetNumberOfPoints(), dtype=bool)
    if at_points is not None:
        bad |= (as_numpy(at_points) & _MARKED_POINT) != 0
    if in_cells is not None and data.GetNumberOfCells() == len(bad):  # a vertex a parcel, in order
        bad |= (as_numpy(in_cells) & _MARKED_CELL) != 0
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
