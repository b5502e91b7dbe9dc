"""Random small cases of numbers that float32 holds, their files in random pieces, and what is read
of them in the case's own coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.constants import AVOGADRO_PER_MOL
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Spray
from tests.unit.cfd.conftest import Block
from tests.unit.cfd.test_vtk import grid_of, vtk_array
from tests.unit.cfd.vtkfiles import collection, pieces, vertices

Array = NDArray[Any]
Random = np.random.Generator
# a voxel's corners in the order of a hexahedron, and the faces of either, normals outwards
_RING = [0, 1, 3, 2, 4, 5, 7, 6]
_CUBE = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def _single(values: Array) -> Array:
    """Numbers that float32 holds, as doubles."""
    return values.astype(np.float32).astype(np.float64)


@dataclass(frozen=True)
class Case:
    """Boxes of gas and parcels; `corners` (N, 8) of a voxel."""

    block: Block
    gas: dict[str, Array]
    cloud: dict[str, Array]
    nozzle_m: tuple[float, float, float]

    def spec(self, file: Path) -> CfdSpray:
        """The import, with everything given that could be inferred."""
        return CfdSpray(file=file, nozzle_m=self.nozzle_m, axis="-y")

    @property
    def corners(self) -> Array:
        nx, ny, nz = self.block.shape
        corner = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nz + 1, ny + 1, nx + 1)
        cut = slice(None, -1), slice(1, None)
        layers = [corner[z, y, x] for z in cut for y in cut for x in cut]
        return np.stack(layers, axis=-1).reshape(-1, 8)

    def gas_rows(self) -> Array:
        """Lower and upper corner, molecules a volume and temperature of each cell, in order."""
        box = self.block.points[self.corners]
        number = self.gas["rho"] * self.gas["C7H16"] * (AVOGADRO_PER_MOL / 0.100204)
        return _rows(box.min(axis=1), box.max(axis=1), number, self.gas["T"])

    def parcel_rows(self) -> Array:
        """Position, diameter, number, temperature and density of each parcel, in order."""
        keys = ("position", "d", "nParticle", "T", "rho")
        return _rows(*(self.cloud[key] for key in keys))


def _rows(*columns: Array) -> Array:
    """(N, all columns), in the order of the places, of which no two are closer than rounding."""
    table = np.column_stack(columns)
    return np.asarray(table[np.lexsort(np.round(table[:, 2::-1] * 1e8).T)])


def rows_read(spray: Spray, case: Case) -> tuple[Array, Array]:
    """As `gas_rows` and `parcel_rows`; the axis -y became -z: x, y, z was x, z, -y."""
    assert spray.vapour is not None
    assert spray.parcels is not None
    nozzle = np.array(case.nozzle_m)

    def back(place: Array) -> Array:
        turned = np.stack([place[:, 0], place[:, 2], -place[:, 1]], axis=1)
        return np.asarray(turned + nozzle)

    cells, parcels = spray.vapour.cells, spray.parcels
    one, other = back(cells.lower_m), back(cells.upper_m)
    return (
        _rows(
            np.minimum(one, other),
            np.maximum(one, other),
            spray.vapour.number_density_m3,
            spray.vapour.temperature_K,
        ),
        _rows(
            back(parcels.position_m),
            parcels.diameter_m,
            parcels.droplets,
            parcels.temperature_K,
            parcels.density_kg_m3,
        ),
    )


def random_case(random: Random) -> Case:
    """2 to 4 cells each way, 1 to 30 parcels, all within some millimetres."""
    edges = [
        _single(np.cumsum([random.uniform(-4e-3, 0), *random.uniform(1e-3, 3e-3, count)]))
        for count in random.integers(2, 5, 3)
    ]
    block = Block((edges[0], edges[1], edges[2]))
    many = int(random.integers(1, 31))
    low, high = np.array([e[0] for e in edges]), np.array([e[-1] for e in edges])
    inside = 1e-4 * (high - low)  # a place that is rounded stays in the mesh
    gas = {
        "T": random.uniform(300.0, 2500.0, block.cells),
        "rho": random.uniform(0.5, 60.0, block.cells),
        "C7H16": random.uniform(1e-4, 1.0, block.cells),
    }
    cloud = {
        "position": random.uniform(low + inside, high - inside, (many, 3)),
        "d": random.uniform(1e-6, 2e-4, many),
        "nParticle": random.uniform(0.01, 1e5, many),
        "T": random.uniform(270.0, 600.0, many),
        "rho": random.uniform(300.0, 1000.0, many),
        "U": random.normal((0.0, -80.0, 0.0), 5.0, (many, 3)),
    }
    top = (float(low[0] + high[0]) / 2, float(high[1]), float(low[2] + high[2]) / 2)
    return Case(
        block,
        {name: _single(values) for name, values in gas.items()},
        {name: _single(values) for name, values in cloud.items()},
        top,
    )


def write_vtk(folder: Path, case: Case, random: Random) -> Path:
    """The case by vtk's writers: cells of random kinds in random pieces, with ghosts of others.

    Some pieces may be empty. Pieces lie in a .pvtu and a .pvtp, or a .vtm names all.
    """
    count = int(random.integers(1, 5))
    piece = random.integers(0, random.integers(1, count + 1), case.block.cells)
    meshes = []
    for number in range(count):
        own = np.flatnonzero(piece == number)
        others = np.flatnonzero((piece != number) & (random.random(len(piece)) < 0.2))
        meshes.append(_mesh(case, own, others if len(own) else own, random))
    whose = random.integers(0, count, len(case.cloud["d"]))
    drops = [
        {name: values[whose == number] for name, values in case.cloud.items()}
        for number in range(count)
    ]
    together = random.random() < 0.5
    # parcels without cells are told by the name of a .vtp, a .vtu needs a vertex
    vertex = together and all(len(each["d"]) for each in drops)
    names: dict[str, list[str]] = {"gas": [], "drops": []}
    for number, (grid, cloud) in enumerate(zip(meshes, drops, strict=True)):
        data = vertices(cloud) if vertex else _points(cloud)
        for name, each, kind in (("gas", grid, "vtu"), ("drops", data, "vtu" if vertex else "vtp")):
            inside = f"parts/{name}_{number}.{kind}"
            _save(folder / inside, each, random)
            names[name].append(inside)
    gas = pieces(folder / "gas.pvtu", names["gas"])
    cloud_file = pieces(folder / f"drops.p{'vtu' if vertex else 'vtp'}", names["drops"])
    if not together:
        return folder
    return collection(folder / "all.vtm", {"gas": gas.name, "drops": cloud_file.name})


def _points(cloud: dict[str, Array]) -> Any:
    from tests.unit.cfd.test_vtk import cloud_data

    return cloud_data(cloud)


def _mesh(case: Case, own: Array, ghosts: Array, random: Random) -> Any:
    """Cells of a piece, and copies of other pieces' that are marked as such."""
    chosen = random.permutation(np.concatenate([own, ghosts]))
    corners = case.corners[chosen]
    used, place = np.unique(corners, return_inverse=True)
    cells: list[tuple[int, Any]] = []
    for eight in place.reshape(-1, 8).tolist():
        ring = [eight[n] for n in _RING]
        kind = int(random.choice([11, 12, 42]))
        faces = [tuple(ring[n] for n in face) for face in _CUBE]
        cells.append((kind, {11: eight, 12: ring, 42: faces}[kind]))
    fields = {name: values[chosen] for name, values in case.gas.items()}
    grid = grid_of(cells, case.block.points[used], fields)
    marks = vtk_array("vtkGhostType", np.isin(chosen, ghosts))
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    bytes_: Any = vtkUnsignedCharArray()
    bytes_.DeepCopy(marks)
    bytes_.SetName("vtkGhostType")
    grid.GetCellData().AddArray(bytes_)
    return grid


def _save(file: Path, data: Any, random: Random) -> None:
    """In any of the forms of vtk's XML."""
    from vtkmodules import vtkIOXML

    file.parent.mkdir(parents=True, exist_ok=True)
    kind = "UnstructuredGrid" if file.suffix == ".vtu" else "PolyData"
    writer = getattr(vtkIOXML, f"vtkXML{kind}Writer")()
    writer.SetFileName(str(file))
    writer.SetInputData(data)
    writer.SetDataMode(int(random.integers(3)))  # ascii, binary, appended
    writer.SetCompressorType(int(random.integers(4)))  # none, zlib, lz4, lzma
    writer.SetHeaderType(int(random.choice([32, 64])))
    writer.SetEncodeAppendedData(int(random.integers(2)))
    assert writer.Write()
