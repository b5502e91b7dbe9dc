"""Large CFD cases to be imported: a cube of hexahedra with a jet, in several forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.mesh.elements import FACES
from cldit.io.files import write_bytes

Floats = NDArray[np.floating]
Ints = NDArray[np.int64]

_EDGE_M = 0.1
_HEXAHEDRON = 12
_HEAD = (
    'FoamFile {{ version 2.0; format binary; arch "LSB;label=32;scalar=64"; class {kind}; '
    "object {name}; }}\n"
)


def write_hexahedra(folder: Path, *, cells_a_side: int, parcels: int) -> None:
    """foamToVTK's layout, raw float32: hexahedra in a .vtu, parcels in a .vtp."""
    grid = _grid(cells_a_side)
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    cells = vtkCellArray()
    cells.SetData(8, _ids(_corners(cells_a_side)))
    grid.SetCells(_HEXAHEDRON, cells)
    _write(folder / "case_1" / "internal.vtu", grid)
    if parcels:
        _write(folder / "lagrangian" / "spray" / "spray_1.vtp", _cloud(parcels))


def write_polyhedra(folder: Path, *, cells_a_side: int, parcels: int) -> None:
    """As `write_hexahedra`, each cell given by its faces."""
    grid = _grid(cells_a_side)
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    corners = _corners(cells_a_side)
    around = np.array(FACES[_HEXAHEDRON]).reshape(-1)
    cells, faces, of_cell = vtkCellArray(), vtkCellArray(), vtkCellArray()
    cells.SetData(8, _ids(corners))
    faces.SetData(4, _ids(corners[:, around]))
    of_cell.SetData(6, _ids(np.arange(6 * len(corners))))
    types: Any = _vtk(np.full(len(corners), 42, np.uint8))
    grid.SetPolyhedralCells(types, cells, of_cell, faces)
    _write(folder / "case_1" / "internal.vtu", grid)
    if parcels:
        _write(folder / "lagrangian" / "spray" / "spray_1.vtp", _cloud(parcels))


def write_foam(folder: Path, *, cells_a_side: int, parcels: int) -> None:
    """An OpenFOAM case, binary, of gas alone."""
    n = cells_a_side
    point = np.arange((n + 1) ** 3).reshape((n + 1,) * 3)  # [z, y, x]
    cell = np.arange(n**3).reshape((n,) * 3)
    inner: list[tuple[Ints, Ints, Ints]] = []
    outer: list[tuple[Ints, Ints]] = []
    for axis, (b, c) in ((2, (1, 0)), (1, (0, 2)), (0, (2, 1))):
        # corners of all faces normal to an axis, so that their normal points along it
        planes = np.moveaxis(point, (axis, b, c), (0, 1, 2))
        quads = np.stack(
            [planes[:, :-1, :-1], planes[:, 1:, :-1], planes[:, 1:, 1:], planes[:, :-1, 1:]], -1
        )
        own = np.moveaxis(cell, (axis, b, c), (0, 1, 2))
        inner.append((quads[1:-1].reshape(-1, 4), own[:-1].reshape(-1), own[1:].reshape(-1)))
        outer.append((quads[0, ..., ::-1].reshape(-1, 4), own[0].reshape(-1)))
        outer.append((quads[-1].reshape(-1, 4), own[-1].reshape(-1)))
    faces = np.concatenate([each[0] for each in (*inner, *outer)])
    owner = np.concatenate([each[1] for each in (*inner, *outer)])
    neighbour = np.concatenate([each[2] for each in inner])
    mesh = folder / "constant" / "polyMesh"
    _foam(mesh / "points", "vectorField", _list(_points(n).astype(np.float64)))
    start = _list(np.arange(0, faces.size + 1, 4, dtype=np.int32))
    _foam(mesh / "faces", "faceCompactList", start + _list(faces.reshape(-1).astype(np.int32)))
    _foam(mesh / "owner", "labelList", _list(owner.astype(np.int32)))
    _foam(mesh / "neighbour", "labelList", _list(neighbour.astype(np.int32)))
    patch = f"1(walls {{ type wall; nFaces {len(owner) - len(neighbour)}; "
    patch += f"startFace {len(neighbour)}; }})"
    _foam(mesh / "boundary", "polyBoundaryMesh", patch.encode(), form="ascii")
    control = b"startTime 0; endTime 1; deltaT 1e-3; writeControl timeStep; writeInterval 1;"
    _foam(folder / "system" / "controlDict", "dictionary", control, form="ascii")
    for name, values in _gas(n).items():
        powers = _POWERS.get(name, b"0 0 0 0 0")
        body = b"dimensions [" + powers + b" 0 0];\ninternalField nonuniform List<scalar> "
        body += _list(values.astype(np.float64)) + b";\nboundaryField { walls { type calculated; "
        body += b"value uniform 0; } }"
        _foam(folder / "0.001" / name, "volScalarField", body)
    (folder / "case.foam").touch()


_POWERS = {"T": b"0 0 0 1 0", "p": b"1 -1 -2 0 0", "rho": b"1 -3 0 0 0"}


def _points(n: int) -> NDArray[np.float32]:
    """Corners of the cells (P, 3), x fastest; the nozzle is in the middle of the side y = 0."""
    edge = np.linspace(0.0, _EDGE_M, n + 1)
    z, y, x = np.meshgrid(edge - _EDGE_M / 2, edge - _EDGE_M, edge - _EDGE_M / 2, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)


def _corners(n: int) -> Ints:
    point = np.arange((n + 1) ** 3).reshape((n + 1,) * 3)
    low, high = slice(None, -1), slice(1, None)
    ring = ((low, low), (low, high), (high, high), (high, low))  # y, x
    return np.stack([point[z, y, x] for z in (low, high) for y, x in ring], -1).reshape(-1, 8)


def _gas(n: int) -> dict[str, NDArray[np.float32]]:
    """Fuel that spreads from the nozzle, cold where it is; a gas by the ideal gas law."""
    middle = (np.arange(n) + 0.5) * (_EDGE_M / n)
    z, y, x = np.meshgrid(
        middle - _EDGE_M / 2, middle - _EDGE_M, middle - _EDGE_M / 2, indexing="ij"
    )
    fuel = 0.2 * np.exp(-(x**2 + z**2) / 0.01**2 + y / 0.03).reshape(-1)
    temperature = 800.0 - 1500.0 * fuel
    moles_kg = fuel / 0.100204 + (1.0 - fuel) / 0.02885
    pressure = np.full(fuel.size, 5e6)
    density = pressure / (moles_kg * 8.31446 * temperature)
    gas = {"T": temperature, "p": pressure, "rho": density, "C7H16": fuel}
    return {name: values.astype(np.float32) for name, values in gas.items()}


def _vtk(values: Any, name: str = "") -> Any:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.numpy_to_vtk
    array = convert(np.ascontiguousarray(values), deep=1)
    array.SetName(name)
    return array


def _ids(values: Ints) -> Any:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.numpy_to_vtkIdTypeArray
    return convert(np.ascontiguousarray(values).reshape(-1), deep=1)


def _placed(data: Any, position: Floats) -> Any:
    from vtkmodules.vtkCommonCore import vtkPoints

    points = vtkPoints()
    points.SetData(_vtk(position.astype(np.float32)))
    data.SetPoints(points)
    return data


def _grid(n: int) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    grid = _placed(vtkUnstructuredGrid(), _points(n))
    for name, values in _gas(n).items():
        grid.GetCellData().AddArray(_vtk(values, name))
    return grid


def _cloud(parcels: int) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    random = np.random.default_rng(1)
    depth = random.uniform(1e-3, 0.05, parcels)
    aside = 0.1 * depth * random.normal(size=(2, parcels))
    position = np.stack([aside[0], -depth, aside[1]], axis=1)
    data = _placed(vtkPolyData(), position)
    for name, values in {
        "d": random.uniform(2e-6, 4e-5, parcels),
        "nParticle": random.uniform(1.0, 100.0, parcels),
        "T": random.uniform(320.0, 500.0, parcels),
        "rho": random.uniform(500.0, 660.0, parcels),
        "age": depth / 80.0,
        "U": position / depth[:, None] * 80.0,
    }.items():
        data.GetPointData().AddArray(_vtk(values.astype(np.float32), name))
    return data


def _write(file: Path, data: Any) -> None:
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    file.parent.mkdir(parents=True)
    writer: Any = (
        vtkXMLPolyDataWriter() if file.suffix == ".vtp" else vtkXMLUnstructuredGridWriter()
    )
    writer.SetFileName(str(file))
    writer.SetInputData(data)
    writer.SetDataModeToAppended()
    writer.SetEncodeAppendedData(0)
    writer.SetCompressorTypeToNone()
    writer.Write()


def _list(values: NDArray[np.generic]) -> bytes:
    return f"{len(values)}(".encode() + values.tobytes() + b")\n"


def _foam(file: Path, kind: str, body: bytes, *, form: str = "binary") -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    head = _HEAD.format(kind=kind, name=file.name).replace("binary", form)
    write_bytes(file, head.encode() + body, sync=False)
