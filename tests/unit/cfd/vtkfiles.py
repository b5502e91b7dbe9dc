"""Small VTK files as ParaView writes them: one block of gas, one cloud, by the vtk wheel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.test_vtk import block_grid, cloud_data, grid_of, save


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
