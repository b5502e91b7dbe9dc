"""CGNS of polyhedra, of mixed sections, with its mesh in another file: one spray."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.cfd.composites import node, write_cgns
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, read, refused

h5py = pytest.importorskip("h5py")


ZONE = "Base/Zone"


def section(zone: Any, name: str, kind: int, first: int, lists: list[Any]) -> Any:
    """Elements of lists of numbers, and their offsets."""
    part = node(zone, name, "Elements_t", [kind, 0])
    node(part, "ElementRange", "IndexRange_t", [first, first + len(lists) - 1])
    node(part, "ElementConnectivity", "DataArray_t", np.concatenate(lists))
    node(part, "ElementStartOffset", "DataArray_t", np.cumsum([0, *map(len, lists)]))
    return part


def polyhedra(zone: Any, block: Any) -> None:
    """Faces in two sections, the boundary first; every third is reversed, with its sign."""
    inner = len(block.neighbour)
    order = [*range(inner, len(block.owner)), *range(inner)]
    signed: list[list[int]] = [[] for _ in range(block.cells)]
    faces = []
    for number, face in enumerate(order, start=1):
        sign = -1 if number % 3 == 0 else 1
        faces.append([corner + 1 for corner in block.faces[face][::sign]])
        signed[block.owner[face]].append(sign * number)
        if face < inner:
            signed[block.neighbour[face]].append(-sign * number)
    outer = len(block.owner) - inner
    section(zone, "A", 22, 1, faces[:outer])
    section(zone, "B", 22, outer + 1, faces[outer:])
    section(zone, "C", 23, len(order) + 1, signed)


def mixed(zone: Any, hexahedra: Any) -> None:
    """A square between hexahedra, which is no cell."""
    rows = [[17, *row] for row in hexahedra]
    section(zone, "A", 20, 1, [*rows[:5], [7, *hexahedra[0][:4]], *rows[5:]])


def changed(path: Path, block: Any, kind: str) -> Path:
    with h5py.File(path, "a") as file:
        zone = file[ZONE]
        rows = zone["Hexahedra/ElementConnectivity/ data"][()].reshape(-1, 8)
        del zone["Hexahedra"]
        if kind == "polyhedra":
            polyhedra(zone, block)
        else:
            mixed(zone, rows)
    return path


@pytest.mark.parametrize("points", [False, True])
@pytest.mark.parametrize("kind", ["polyhedra", "mixed"])
def test_cells_of_another_section_are_the_same_cells(
    tmp_path: Path, kind: str, points: bool
) -> None:
    sample = foam.sample()
    whole = notes_of(write_cgns(tmp_path / "a.cgns", sample, points=points))
    path = changed(write_cgns(tmp_path / "b.cgns", sample, points=points), sample[0], kind)
    assert notes_of(path) == pytest.approx(whole, rel=1e-12)


def test_a_mesh_in_another_file(tmp_path: Path) -> None:
    sample = foam.sample()
    mesh = write_cgns(tmp_path / "mesh.cgns", sample)
    whole = notes_of(mesh)
    path = write_cgns(tmp_path / "result.cgns", sample)
    with h5py.File(path, "a") as file:
        for name in ("GridCoordinates", "Hexahedra"):
            del file[f"{ZONE}/{name}"]
            link = node(file[ZONE], name, "", form="LK")
            link[" link"] = h5py.ExternalLink("mesh.cgns", f"/{ZONE}/{name}")
    found = read(path)
    assert found.notes == whole
    assert {Path(file.path).name for file in found.files} == {"mesh.cgns", "result.cgns"}
    mesh.rename(tmp_path / "gone.cgns")
    refused(path, r"mesh\.cgns")


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("C", lambda values: np.abs(values), "belongs to cells in the same sense"),
        ("C", lambda values: values + 1000, "a face that does not exist"),
        ("A", lambda values: values * 0 + 10_000, "point labels .* allowed: 0"),
        ("A", lambda values: values[:-1], "offsets 0 to .* numbers"),
    ],
)
def test_damaged_polyhedra(tmp_path: Path, name: str, change: Any, message: str) -> None:
    sample = foam.sample()
    path = changed(write_cgns(tmp_path / "a.cgns", sample), sample[0], "polyhedra")
    with h5py.File(path, "a") as file:
        data = file[f"{ZONE}/{name}/ElementConnectivity"]
        values = change(data[" data"][()])
        del data[" data"]
        data[" data"] = values
    refused(path, message)


def test_dimensions_of_another_quantity(tmp_path: Path) -> None:
    path = write_cgns(tmp_path / "a.cgns", foam.sample())
    for powers in ([1, -1, -2, 0, 0], [0, 2, -2, 0, 0]):
        with h5py.File(path, "a") as file:
            field = file[f"{ZONE}/Solution/Pressure"]
            field.pop("DimensionalExponents", None)
            node(field, "DimensionalExponents", "DimensionalExponents_t", powers)
        if powers[0]:
            read(path)
    refused(path, r"Pressure: cells\.pressure: unit '\[0, 2, -2, 0, 0\]' is")
