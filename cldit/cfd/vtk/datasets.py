"""vtk data sets as numpy arrays; the only module that imports vtk, and only when it is called."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.mesh import Labels, Mesh
from cldit.errors import SprayError

# Faces of vtk's linear cells, normals outwards (VTK file formats, figure "Linear cell types").
FACES: dict[int, tuple[tuple[int, ...], ...]] = {
    10: ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),  # tetrahedron
    11: (  # voxel: the points count up in x, then y, then z
        (0, 4, 6, 2),
        (1, 3, 7, 5),
        (0, 1, 5, 4),
        (2, 6, 7, 3),
        (0, 2, 3, 1),
        (4, 5, 7, 6),
    ),
    12: (  # hexahedron
        (0, 4, 7, 3),
        (1, 2, 6, 5),
        (0, 1, 5, 4),
        (3, 7, 6, 2),
        (0, 3, 2, 1),
        (4, 5, 6, 7),
    ),
    13: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),  # wedge
    14: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),  # pyramid
}
_POLYHEDRON = 42


def load_vtk(file: Path, kind: str = "vtkDataSet") -> Any:
    """The data set in a .vtu, .vtp or binary legacy .vtk file.

    Raises:
        SprayError: vtk is not installed; the file is damaged, truncated, or not of this kind.
    """
    try:
        from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow
        from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader
    except ImportError as error:
        raise SprayError(
            f'{file}: reading it needs vtk; install it with: pip install "cldit[cfd]"'
        ) from error
    readers: dict[str, Any] = {
        ".vtu": vtkXMLUnstructuredGridReader,
        ".vtp": vtkXMLPolyDataReader,
        ".vtk": vtkGenericDataObjectReader,
    }
    if file.suffix == ".vtk":
        with file.open("rb") as stream:
            if re.search(rb"\n\s*ASCII\s*\n", stream.read(1000)):
                raise SprayError(
                    f"{file}: is legacy VTK in ascii, whose truncation vtk does not notice; "
                    "write it in binary or as .vtu"
                )
    # vtk reports what is wrong with a file only as text in its output window
    before, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader = readers[file.suffix]()
        reader.SetFileName(str(file))
        reader.Update()
        data = reader.GetOutput()
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(before)
    text: Any = window.GetOutput()
    if isinstance(text, bytes):  # where the message quotes a damaged file
        text = text.decode("latin-1")
    said = re.search(r"(?:ERROR|Warning):[^\n]*\n([^\n]*)", text)
    if said or reader.GetErrorCode():
        if (bad := _BAD_NAME.search(_head(file))) is not None:
            raise SprayError(
                f"{file}: names a field {bad.group(1).decode('latin-1')!r} with a mark that XML "
                "does not allow, as foamToVTK of v1912 does; export only what is needed: "
                "foamToVTK -fields '(T p rho C7H16)'"
            )
        reason = ascii(said.group(1)).strip("'\"") if said else f"vtk error {reader.GetErrorCode()}"
        raise SprayError(f"{file}: is damaged or truncated ({reason})")
    if data is None or not data.IsA(kind):
        found = "nothing" if data is None else data.GetClassName()
        raise SprayError(f"{file}: holds {found}, expected {kind}")
    return data


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
    """
    if dimension(data) > 0:
        ghosts = data.GetCellData().GetArray("vtkGhostType")
        if ghosts is None or not (bad := (_numpy(ghosts) & _MARKED_CELL) != 0).any():
            return data
        marked.cells += int(bad.sum())
        return _cells_of(data, np.flatnonzero(~bad))
    bad = np.zeros(data.GetNumberOfPoints(), dtype=bool)
    ghosts = data.GetPointData().GetArray("vtkGhostType")
    if ghosts is not None:
        bad |= (_numpy(ghosts) & _MARKED_POINT) != 0
    ghosts = data.GetCellData().GetArray("vtkGhostType")
    if ghosts is not None and data.GetNumberOfCells() == len(bad):  # a vertex a parcel, in order
        bad |= (_numpy(ghosts) & _MARKED_CELL) != 0
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


def dimension(data: Any) -> int:
    """Largest dimension of its cells, 0 for points alone; -1 of a data set without anything."""
    if not data.GetNumberOfCells():
        return 0 if data.GetNumberOfPoints() else -1
    if data.IsA("vtkPolyData"):
        if data.GetNumberOfPolys() or data.GetNumberOfStrips():
            return 2
        return 1 if data.GetNumberOfLines() else 0
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
    points = _numpy(data.GetPoints().GetData())
    if not data.IsA("vtkUnstructuredGrid"):
        return (points,)
    return points, _numpy(data.GetCells().GetConnectivityArray())


def corner_mean(grid: Any) -> Callable[[Any], Any]:
    """A function of values at points (P,) that gives their means over each cell's corners (N,)."""

    def mean(values: Any) -> Any:
        cells = grid.GetCells()
        points = _numpy(cells.GetConnectivityArray())
        offsets = _numpy(cells.GetOffsetsArray()).astype(np.int64)
        sums = np.add.reduceat(values[points], offsets[:-1])
        return sums / np.diff(offsets)

    return mean


_BAD_NAME = re.compile(rb"Name=[\"']([^\"'\n]*<[^\"'\n]*)[\"']")


def _head(file: Path) -> bytes:
    """The file up to its appended numbers, where the names of its fields stand."""
    return file.read_bytes().partition(b"<AppendedData")[0]


def time_value(data: Any) -> float | None:
    """The `TimeValue` that foamToVTK adds, if there is one."""
    values = data.GetFieldData().GetArray("TimeValue")
    return None if values is None or not values.GetNumberOfValues() else values.GetValue(0)


def cell_columns(file: Path, data: Any) -> dict[str, Column]:
    """Numeric cell arrays of `data` by name; `file` is named by errors."""
    return _columns(file, data.GetCellData(), "cell field")


def point_columns(file: Path, data: Any) -> tuple[Column, dict[str, Column]]:
    """Positions (N, 3), and numeric point arrays of `data` by name; `file` is named by errors."""
    return (
        Column(f"{file}: points", _points(data)),
        _columns(file, data.GetPointData(), "point field"),
    )


def _numpy(array: Any) -> Any:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return convert(array)


def _points(data: Any) -> Any:
    if not data.GetNumberOfPoints():
        return np.empty((0, 3))
    return _numpy(data.GetPoints().GetData()).astype(np.float64)


def _columns(file: Path, data: Any, kind: str) -> dict[str, Column]:
    arrays = [data.GetArray(index) for index in range(data.GetNumberOfArrays())]
    return {
        array.GetName(): Column(
            f"{file}: {kind} {array.GetName()}", _numpy(array).astype(np.float64)
        )
        for array in arrays
        if array is not None and array.GetName()
    }


def vtk_mesh(file: Path, grid: Any) -> Mesh:
    """The mesh of an unstructured `grid` of linear cells and polyhedra, each face once a cell.

    Errors name `file`.

    Raises:
        SprayError: the grid has a cell of another type, or none.
    """
    count = grid.GetNumberOfCells()
    if count == 0:
        raise SprayError(f"{file}: the mesh has no cell")
    types = np.array([grid.GetCellType(0)])
    if not grid.IsHomogeneous():
        types = np.fromiter((grid.GetCellType(cell) for cell in range(count)), np.int64, count)
    types = np.broadcast_to(types, count)
    cells = grid.GetCells()
    points = _numpy(cells.GetConnectivityArray()).astype(np.int64)
    offsets = _numpy(cells.GetOffsetsArray()).astype(np.int64)

    corners: list[Labels] = []
    sizes: list[Labels] = []
    owners: list[Labels] = []
    for kind in np.unique(types).tolist():
        members = np.flatnonzero(types == kind)
        if kind == _POLYHEDRON:
            for cell in members.tolist():
                flat, size = _polyhedron(grid, cell)
                corners.append(flat)
                sizes.append(size)
                owners.append(np.full(len(size), cell))
            continue
        if kind not in FACES:
            raise SprayError(
                f"{file}: cell {members[0]} is of vtk type {kind}; expected tetrahedra, "
                "hexahedra, voxels, wedges, pyramids or polyhedra"
            )
        for face in FACES[kind]:
            corners.append(points[offsets[members, None] + np.array(face)].reshape(-1))
            sizes.append(np.full(len(members), len(face)))
            owners.append(members)
    size = np.concatenate(sizes)
    return Mesh(
        points_m=_points(grid),
        corners=np.concatenate(corners),
        start=np.concatenate([[0], np.cumsum(size)]),
        owner=np.concatenate(owners),
        neighbour=np.full(len(size), -1, dtype=np.int64),
        cells=count,
        source=str(file),
    )


def _polyhedron(grid: Any, cell: int) -> tuple[Labels, Labels]:
    """Corners of a polyhedron's faces, one after the other, and the number of each face's."""
    from vtkmodules.vtkCommonCore import vtkIdList

    stream = vtkIdList()
    grid.GetFaceStream(cell, stream)
    numbers = [stream.GetId(place) for place in range(stream.GetNumberOfIds())]
    corners: list[int] = []
    sizes: list[int] = []
    here = 1  # behind the number of faces
    for _ in range(numbers[0]):
        sizes.append(numbers[here])
        corners += numbers[here + 1 : here + 1 + numbers[here]]
        here += 1 + numbers[here]
    return np.array(corners), np.array(sizes)
