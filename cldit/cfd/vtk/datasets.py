"""vtk data sets as NumPy arrays. vtk is imported only when a function is called."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.mesh.cells import Polyhedra
from cldit.cfd.mesh.elements import ElementMesh
from cldit.errors import SprayError

GHOSTS = "vtkGhostType"  # name of the array that marks cells and points


def dimension(data: Any) -> int:
    """Largest dimension of its cells, 0 for points alone; -1 of an empty data set."""
    if not data.GetNumberOfCells():
        return 0 if data.GetNumberOfPoints() else -1
    return int(data.GetMaxSpatialDimension())


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
        array = make(marks if ghosts is None else marks | as_numpy(ghosts), deep=True)
        array.SetName(GHOSTS)
        grid.GetCellData().AddArray(array)
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
    place = Column(f"{file}: points", points_of(data).astype(np.float64))
    return place, {k: replace(v, values=v.values.astype(np.float64)) for k, v in fields.items()}


def as_numpy(array: Any) -> Any:
    """View of a vtk array in NumPy, without a copy."""
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return convert(array)


def points_of(data: Any) -> Any:
    """Coordinates (P, 3) of the points."""
    filled = data.GetNumberOfPoints() > 0
    return as_numpy(data.GetPoints().GetData()) if filled else np.empty((0, 3))


def _columns(file: Path, data: Any, kind: str) -> dict[str, Column]:
    from vtkmodules.vtkCommonCore import vtkDataArray

    key: Any = vtkDataArray.UNITS_LABEL()
    return {
        name: Column(
            f"{file}: {kind} {name}",
            as_numpy(array),
            unit=array.GetInformation().Get(key) if array.HasInformation() else None,
        )
        for name, array in named_arrays(data).items()
    }


def named_arrays(data: Any) -> dict[str, Any]:
    """Numeric arrays of the cells or points, as vtk holds them, by name."""
    arrays = [data.GetArray(index) for index in range(data.GetNumberOfArrays())]
    return {array.GetName(): array for array in arrays if array is not None and array.GetName()}


def vtk_mesh(file: Path, grid: Any) -> ElementMesh:
    """Mesh of an unstructured `grid` of linear cells and polyhedra, on vtk's own arrays."""
    count = grid.GetNumberOfCells()
    if count == 0:
        raise SprayError(f"{file}: the mesh has no cell")
    if grid.IsHomogeneous():
        kinds = np.broadcast_to(np.uint8(grid.GetCellType(0)), count)
    else:
        kinds = as_numpy(grid.GetCellTypes())
    nodes, offsets = lists_of(grid.GetCells())
    faces, locations = grid.GetPolyhedronFaces(), grid.GetPolyhedronFaceLocations()
    points, solids = points_of(grid), None
    if faces is not None and locations is not None and locations.GetNumberOfCells():
        sides, first = lists_of(locations)
        solids = Polyhedra(points, *lists_of(faces), first, sides, np.arange(count))
    return ElementMesh(points, kinds, offsets, nodes, str(file), solids)


def lists_of(cells: Any) -> tuple[Any, Any]:
    """Content of all lists of a vtkCellArray, one after the other, and their offsets."""
    return as_numpy(cells.GetConnectivityArray()), as_numpy(cells.GetOffsetsArray())


def check_cells(file: Path, data: Any) -> None:
    """Refuses cells with points that do not exist, at which vtk's filters would end the process."""
    count = data.GetNumberOfPoints()
    for nodes, start in _cell_arrays(data):
        consistent = start[0] == 0 and start[-1] == len(nodes) and np.all(np.diff(start) >= 0)
        if not consistent or (len(nodes) and not (nodes.min() >= 0 and nodes.max() < count)):
            problem = f"cells that do not fit {len(nodes)} corners and {count} points"
            raise SprayError(f"{file}: is damaged or truncated ({problem})")


def cell_lists(data: Any) -> tuple[Any, Any]:
    """Points of all cells, one cell after the other, and where each cell begins, (N + 1,)."""
    lists = _cell_arrays(data)
    if len(lists) == 1:
        return lists[0]
    sizes = np.concatenate([np.zeros(1, np.int64), *(np.diff(start) for _, start in lists)])
    return np.concatenate([np.empty(0, np.int64), *(nodes for nodes, _ in lists)]), np.cumsum(sizes)


def _cell_arrays(data: Any) -> list[tuple[Any, Any]]:
    kinds = ("GetVerts", "GetLines", "GetPolys", "GetStrips")
    poly = data.IsA("vtkPolyData")
    parts = [getattr(data, kind)() for kind in kinds] if poly else [data.GetCells()]
    return [lists_of(cells) for cells in parts if cells is not None and cells.GetNumberOfCells()]
