"""Small VTK files as ParaView writes them: one block of gas, one cloud, by the vtk wheel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tests.unit.cfd.conftest import foam


def vtk_array(name: str, values: Any, kind: str = "f4") -> Any:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.numpy_to_vtk
    array = convert(np.ascontiguousarray(values, kind), deep=1)
    array.SetName(name)
    return array


def points_of(data: Any, position: Any) -> None:
    from vtkmodules.vtkCommonCore import vtkPoints

    points = vtkPoints()
    points.SetData(vtk_array("Points", position))
    data.SetPoints(points)


def save(file: Path, data: Any) -> Path:
    """By the file's suffix; legacy files in binary."""
    from vtkmodules import vtkIOLegacy, vtkIOXML

    file.parent.mkdir(parents=True, exist_ok=True)
    writers: dict[str, Any] = {
        ".vtu": vtkIOXML.vtkXMLUnstructuredGridWriter,
        ".vtp": vtkIOXML.vtkXMLPolyDataWriter,
        ".vti": vtkIOXML.vtkXMLImageDataWriter,
        ".vtr": vtkIOXML.vtkXMLRectilinearGridWriter,
        ".vts": vtkIOXML.vtkXMLStructuredGridWriter,
        ".vtk": vtkIOLegacy.vtkDataSetWriter,
    }
    writer = writers[file.suffix]()
    writer.SetFileName(str(file))
    writer.SetInputData(data)
    if file.suffix == ".vtk":
        writer.SetFileTypeToBinary()
    assert writer.Write()
    return file


def grid_of(cells: list[tuple[int, Any]], points: Any, gas: Mapping[str, Any]) -> Any:
    """An unstructured grid; a polyhedron is given by its faces."""
    from vtkmodules.vtkCommonCore import vtkIdList
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    grid: Any = vtkUnstructuredGrid()
    points_of(grid, points)
    for kind, corners in cells:
        if kind == 42:
            stream = vtkIdList()
            for item in (len(corners), *(n for face in corners for n in (len(face), *face))):
                stream.InsertNextId(item)
            grid.InsertNextCell(42, stream)
        else:
            grid.InsertNextCell(kind, len(corners), list(corners))
    for name, values in gas.items():
        grid.GetCellData().AddArray(vtk_array(name, values))
    return grid


def block_grid(block: Any, gas: Mapping[str, Any], cells: Any = slice(None)) -> Any:
    """A grid of a block's hexahedra, or of some of them."""
    rows = [(12, row) for row in block.hexahedra[cells].tolist()]
    return grid_of(rows, block.points, {name: values[cells] for name, values in gas.items()})


def mark_ghosts(data: Any, marks: Any) -> None:
    """Adds vtkGhostType to the data of cells or points."""
    data.AddArray(vtk_array("vtkGhostType", marks, "u1"))


def cloud_data(cloud: Mapping[str, Any]) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    data: Any = vtkPolyData()
    points_of(data, cloud["position"])
    for name, values in cloud.items():
        if name != "position":
            data.GetPointData().AddArray(vtk_array(name, values))
    return data


def stamped(data: Any, time_s: float) -> Any:
    data.GetFieldData().AddArray(vtk_array("TimeValue", [time_s]))
    return data


def gas_file(file: Path, **fields: Any) -> Path:
    """The gas of the sample; `fields` are added to it."""
    block, gas, _ = foam.sample()
    return save(file, block_grid(block, gas | fields))


def parcels_file(file: Path) -> Path:
    """The parcels of the sample: points in a .vtp, vertices in a .vtu."""
    _, _, cloud = foam.sample()
    if file.suffix == ".vtp":
        return save(file, cloud_data(cloud))
    return save(file, vertices(cloud))


def cell_arrays(grid: Any, *names: str) -> list[Any]:
    """Volumes of the cells of a grid by vtk, and arrays of these names."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter

    sizes: Any = vtkCellSizeFilter()
    sizes.SetInputData(grid)
    sizes.Update()
    data: Any = sizes.GetOutput().GetCellData()
    convert: Any = numpy_support.vtk_to_numpy
    return [convert(data.GetArray(name)) for name in ("Volume", *names)]


def vertices(cloud: Mapping[str, Any]) -> Any:
    """A grid of a vertex for each parcel, which is what some exporters write."""
    points = cloud_data(cloud)
    count = points.GetNumberOfPoints()
    grid = grid_of([(1, (place,)) for place in range(count)], cloud["position"], {})
    for index in range(points.GetPointData().GetNumberOfArrays()):
        grid.GetPointData().AddArray(points.GetPointData().GetArray(index))
    return grid


def collection(file: Path, names: Mapping[str, str]) -> Path:
    """A .vtm file that names others."""
    rows = "".join(
        f'<Block index="{n}"><DataSet index="0" name="{name}" file="{inside}"/></Block>'
        for n, (name, inside) in enumerate(names.items())
    )
    text = '<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>'
    file.write_text(f"{text}{rows}</vtkMultiBlockDataSet></VTKFile>")
    return file


def pvd(file: Path, steps: Mapping[str, list[str]]) -> Path:
    """A .pvd file of the files of each time."""
    rows = "".join(
        f'<DataSet timestep="{time}" part="{part}" file="{name}"/>'
        for time, names in steps.items()
        for part, name in enumerate(names)
    )
    file.write_text(f'<VTKFile type="Collection"><Collection>{rows}</Collection></VTKFile>')
    return file


def pieces(file: Path, names: list[str]) -> Path:
    """A .pvtu or .pvtp file of pieces."""
    rows = "".join(f'<Piece Source="{name}"/>' for name in names)
    kind = "PUnstructuredGrid" if file.suffix == ".pvtu" else "PPolyData"
    file.write_text(f'<VTKFile type="{kind}"><{kind} GhostLevel="0">{rows}</{kind}></VTKFile>')
    return file
