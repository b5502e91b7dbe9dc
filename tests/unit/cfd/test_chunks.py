"""Cells some at a time: the same figures, whatever the number, and labels that are checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.mesh import cells as meshes
from cldit.cfd.mesh.elements import POLYHEDRON, ElementMesh
from cldit.cfd.openfoam import lists as foamlists
from cldit.cfd.openfoam.file import FoamFile
from cldit.cfd.openfoam.lists import faces, labels, scalars
from cldit.cfd.vtk import head
from cldit.cfd.vtk.head import piece_counts
from cldit.errors import SprayError
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read, same

CUBE = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
FACES = meshes.Polyhedra(
    points_m=CUBE,
    corners=np.array([0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]),
    start=np.arange(0, 25, 4),
    sides=np.arange(6),
    first=np.array([0, 0, 6]),
    members=np.arange(2),
)
# a hexahedron, and the same as a polyhedron
TWO = ElementMesh(
    CUBE, np.array([12, POLYHEDRON]), np.array([0, 8, 16]), np.tile(np.arange(8), 2), "two", FACES
)


@pytest.mark.parametrize("at_once", [1, 5, 23])
def test_number_of_cells_at_once_changes_nothing(
    at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block, gas, cloud = foam.sample(shear=0.3)
    case = foam.write(tmp_path / "case", block, gas=gas, cloud=cloud)
    whole = read(case)
    monkeypatch.setattr(meshes, "AT_ONCE", at_once)
    assert same(read(case), whole)


def test_cells_without_vapour_are_left_out_wherever_they_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the first cell with much fuel it is not known yet that another has next to none."""
    block, gas, cloud = foam.sample()
    gas["C7H16"][:] = 0.0
    gas["C7H16"][[1, 20]] = 1e-18, 0.2
    case = foam.write(tmp_path / "case", block, gas=gas, cloud=cloud)
    monkeypatch.setattr(meshes, "AT_ONCE", 4)
    spray = read(case)
    assert spray.notes["vapour_cells"] == 1.0
    assert spray.notes["gas_cells"] == 24.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nodes": np.tile([0, 1, 2, 3, 4, 5, 6, 8], 2)}, r"point labels 0 to 8 .* 0\.\.7"),
        ({"nodes": np.tile([-1, 1, 2, 3, 4, 5, 6, 7], 2)}, r"point labels -1 to 7"),
        ({"kinds": np.array([10, POLYHEDRON])}, "cell 0 of vtk type 10 has 8 corners, expected 4"),
        ({"kinds": np.array([12, 7])}, "cell 1 is of vtk type 7; allowed: tetrahedra"),
        ({"kinds": np.array([12, POLYHEDRON]), "solids": None}, "cell 1 is of vtk type 42"),
        ({"offsets": np.array([0, 8, 15])}, "do not use all of its corners"),
        ({"offsets": np.array([0, 24, 16])}, "cell 0 of vtk type 12 has 24 corners"),
        ({"solids": replace(FACES, corners=FACES.corners + 1)}, r"point labels 1 to 8"),
        ({"solids": replace(FACES, sides=FACES.sides + 1)}, r"face labels 1 to 6"),
        ({"solids": replace(FACES, first=np.array([0, 7, 6]))}, "do not fit their cells"),
        ({"solids": replace(FACES, start=np.array([0, 2, 8, 12, 16, 20, 24]))}, "do not fit"),
        ({"points_m": CUBE * np.nan}, "a point of the mesh is not within"),
    ],
)
def test_labels_outside_are_refused(change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(SprayError, match=f"two: .*{message}"):
        replace(TWO, **change)  # type: ignore[arg-type]


def test_text_is_read_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def file(body: bytes) -> FoamFile:
        return FoamFile(Path("file"), False, "<", (4,), (8,), body)

    values = np.random.default_rng(5).normal(size=200)
    text = f"200(\n{' '.join(map(repr, values.tolist()))}\n)".encode()
    mixed = b"3(3(0 1 2)\n4(0 1 4 3) 3(2 1 4))\n"
    monkeypatch.setattr(foamlists, "AT_ONCE", 7)
    assert np.array_equal(scalars(file(text)), values)
    assert labels(file(b"4(11 22 3333333 -1)")).tolist() == [11, 22, 3333333, -1]
    corners, start = faces(file(mixed))
    assert corners.tolist() == [0, 1, 2, 0, 1, 4, 3, 2, 1, 4]
    assert start.tolist() == [0, 3, 7, 10]
    for bad in (mixed.replace(b"4(", b"9("), mixed.replace(b" 2)", b" x)"), mixed[:-6] + b")"):
        with pytest.raises(SprayError, match=r"do not make 3 faces|no number"):
            faces(file(bad))
    with pytest.raises(SprayError, match=r"1 numbers where 200|no number"):
        scalars(file(text.replace(b" ", b" x ", 1)))
    with pytest.raises(SprayError, match="no whole number"):
        labels(file(b"3(1 2.5 3)"))


@pytest.mark.parametrize("at_once", [50, 1 << 20])
def test_counts_of_pieces(at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(head, "AT_ONCE", at_once)
    piece = b'<Piece NumberOfPoints="12" NumberOfCells="5">\n' + b"0.5 " * 300 + b"</Piece>\n"
    file = tmp_path / "mesh.vtu"
    file.write_bytes(b"<VTKFile>" + 3 * piece + b"</VTKFile>")
    assert piece_counts(file) == (36, 15)
    begin = b"<VTKFile>" + piece.replace(b'"', b"'")
    file.write_bytes(begin + b'<AppendedData encoding="raw">_' + piece)
    assert piece_counts(file) == (12, 5)
