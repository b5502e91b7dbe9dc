"""Geometry of cells against known solids, in parts of any size; labels are checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.mesh import cells as meshes
from cldit.cfd.mesh import elements
from cldit.cfd.mesh.cells import CellMesh, Measures, PointMesh, walk_faces
from cldit.cfd.mesh.elements import POLYHEDRON, ElementMesh
from cldit.cfd.mesh.faces import Mesh, join
from cldit.cfd.openfoam import lists as foamlists
from cldit.cfd.openfoam.cloud import decode
from cldit.cfd.openfoam.file import FoamFile
from cldit.cfd.openfoam.lists import faces, labels, scalars
from cldit.cfd.vtk import head
from cldit.cfd.vtk.head import piece_counts
from cldit.errors import SprayError
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read, same


def solid(points: list[list[float]], faces: list[tuple[int, ...]]) -> Mesh:
    """One cell."""
    return Mesh(
        points_m=np.array(points, dtype=np.float64),
        corners=np.concatenate([np.array(face) for face in faces]),
        start=np.cumsum([0, *map(len, faces)]),
        owner=np.zeros(len(faces), dtype=np.int64),
        neighbour=np.full(len(faces), -1, dtype=np.int64),
        cells=1,
        source="solid",
    )


def measured(mesh: CellMesh) -> Measures:
    """All of its cells."""
    return mesh.measure(np.arange(mesh.cells))


TET = solid(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
)
PYRAMID = solid(
    [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 3]],
    [(0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)],
)
# an arrowhead with its notch in point 1, drawn out to a height of 2
ARROW = solid(
    [[x, y, z] for z in (0, 2) for x, y in ((-1, -1), (0, -0.2), (1, -1), (0, 1))],
    [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
)


@pytest.mark.parametrize(
    ("mesh", "volume", "centroid"),
    [
        (TET, 1 / 6, (0.25, 0.25, 0.25)),
        (PYRAMID, 4.0, (1.0, 1.0, 0.75)),
        # two triangles of area 0.6 each, with centroids in y = (-0.2 - 1 + 1) / 3
        (ARROW, 2 * 1.2, (0.0, -0.2 / 3, 1.0)),
    ],
)
def test_volume_and_centroid(
    mesh: Mesh, volume: float, centroid: tuple[float, float, float]
) -> None:
    found = measured(mesh)
    assert found.volume_m3[0] == pytest.approx(volume, rel=1e-14)
    assert found.centroid_m[0] == pytest.approx(centroid, abs=1e-14)
    # far from the origin, the same but for the rounding of its coordinates, 2e-14 of 100 m
    far = measured(replace(mesh, points_m=mesh.points_m + 100.0))
    assert far.volume_m3[0] == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize("kind", [10, 11, 12, 13])
def test_cells_of_straight_edges_are_as_by_their_faces(kind: int) -> None:
    """An affine image of the cell; where a corner is moved, only its faces tell."""
    random = np.random.default_rng(kind)
    along, share = elements._REGULAR[kind]
    edges = np.eye(3) + 0.3 * random.normal(size=(3, 3))
    count = len(along)
    ends, nodes = np.array([0, count]), np.arange(count)
    for miss in (0.0, 0.9e-4, 0.1):
        points = 5.0 + along @ edges
        points[0] += miss * random.uniform(-0.5, 0.5, size=3)
        mesh = ElementMesh(points, np.array([kind]), ends, nodes, "cell")
        cell, by_faces = measured(mesh), PointMesh.measure(mesh, np.arange(1))
        if kind == 10 or miss == 0.0:  # any tetrahedron is regular
            limits = (1e-13, 1e-14)
        else:
            limits = (4 * miss**2, miss) if miss < 1e-4 else (0.0, 0.0)
        assert cell.volume_m3 == pytest.approx(by_faces.volume_m3, rel=limits[0])
        assert cell.centroid_m == pytest.approx(by_faces.centroid_m, abs=limits[1])
        assert np.array_equal(cell.lower_m, by_faces.lower_m)
        assert np.array_equal(cell.upper_m, by_faces.upper_m)
        if not miss:
            assert cell.volume_m3[0] == pytest.approx(share * abs(np.linalg.det(edges)), rel=1e-12)
    with pytest.raises(SprayError, match="has no volume"):
        measured(replace(mesh, points_m=np.zeros((count, 3))))


def test_inside_out_is_the_same_cell() -> None:
    flipped = solid(TET.points_m.tolist(), [(1, 2, 0), (3, 1, 0), (3, 2, 1), (3, 0, 2)])
    found, expected = measured(flipped), measured(TET)
    assert found.volume_m3 == pytest.approx(expected.volume_m3, abs=1e-15)
    assert found.centroid_m == pytest.approx(expected.centroid_m, abs=1e-15)


def test_join_keeps_cells_apart() -> None:
    both = join([TET, PYRAMID, ARROW])
    assert both.cells == 3
    cell = measured(both)
    assert cell.volume_m3 == pytest.approx([1 / 6, 4.0, 2.4], rel=1e-14)
    assert cell.lower_m[2].tolist() == [-1.0, -1.0, 0.0]
    assert cell.upper_m[1].tolist() == [2.0, 2.0, 3.0]
    assert both.measure(np.array([2, 0])).volume_m3 == pytest.approx([2.4, 1 / 6], rel=1e-14)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ([(0, 2, 1), (0, 1, 3), (1, 2, 3)], "cell 0 has fewer than four faces"),
        ([(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 2, 3)], "do not enclose it, or do not all point"),
        ([(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 0, 0)], "do not enclose it"),
        ([(0, 2, 1), (0, 1, 2), (0, 2, 1), (0, 1, 2)], "cell 0 of the mesh has no volume"),
    ],
)
def test_cells_that_are_none(faces: list[tuple[int, ...]], message: str) -> None:
    with pytest.raises(SprayError, match=f"solid: .*{message}"):
        measured(solid(TET.points_m.tolist(), faces))


def test_barycentric_base_point_of_a_notched_face() -> None:
    """From point 0 of the arrowhead a triangle is inside out; the first good base is point 1.

    The tetrahedron of tet point 1 is then the centroid and points 1, 2, 3 of the top face.
    """
    file = FoamFile(Path("coordinates"), False, "<", (4,), (8,), b"")
    weights = np.array([0.4, 0.3, 0.2, 0.1])
    rows = np.concatenate([weights, [0, 1, 1]])[None]
    centroid = np.array([0.0, -0.2 / 3, 1.0])
    expected = weights @ np.array([centroid, [0, -0.2, 2], [1, -1, 2], [0, 1, 2]])
    assert decode(file, rows, ARROW)[0] == pytest.approx(expected, abs=1e-14)


def test_cells_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells with faces of three and four corners, in any order and any parts, are the same; and so
    are two cells that share a face, which is turned for one of them."""
    solids = (TET, PYRAMID, ARROW)
    faces = np.cumsum([0, *(len(one.corners) for one in solids)])
    points = np.cumsum([0, *(len(one.points_m) for one in solids)])
    owner = np.concatenate([np.full(len(one.owner), cell) for cell, one in enumerate(solids)])
    mesh = Mesh(
        points_m=np.concatenate([one.points_m for one in solids]),
        corners=np.concatenate([one.corners + at for one, at in zip(solids, points, strict=False)]),
        start=np.append(
            0, np.concatenate([one.start[1:] + at for one, at in zip(solids, faces, strict=False)])
        ),
        owner=owner,
        neighbour=np.full(len(owner), -1),
        cells=3,
        source="solids",
    )
    cells = np.array([2, 0, 1, 2])
    alone = [vars(measured(one)) for one in solids]
    for sides in (1, 11, 1000):
        monkeypatch.setattr(meshes, "IN_CACHE", sides)
        for name, values in vars(mesh.measure(cells)).items():
            expected = np.concatenate([alone[cell][name] for cell in cells])
            np.testing.assert_allclose(values, expected, atol=1e-15)
    both = Mesh(
        points_m=np.array([*TET.points_m, [0.0, 0.0, -1.0]]),
        corners=np.array([0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3, 4, 1, 0, 4, 2, 1, 4, 0, 2]),
        start=np.arange(8) * 3,
        owner=np.array([0, 0, 0, 0, 1, 1, 1]),
        neighbour=np.array([1, -1, -1, -1, -1, -1, -1]),
        cells=2,
        source="double",
    )
    assert measured(both).volume_m3 == pytest.approx([1 / 6, 1 / 6], rel=1e-14)


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
    case = foam.case(tmp_path / "case", shear=0.3)
    whole = read(case)
    monkeypatch.setattr(meshes, "AT_ONCE", at_once)
    assert same(read(case), whole)


def test_cells_without_vapour_are_left_out_wherever_they_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the first cell with much fuel it is not known yet that another has next to none."""
    fuel = np.zeros(24)
    fuel[[1, 20]] = 1e-18, 0.2
    case = foam.case(tmp_path / "case", gas={"C7H16": fuel})
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


def test_faces_one_after_the_other() -> None:
    """Places of sizes, and lists that are none: a size of 0, and one beyond the end."""
    numbers = np.array([3, 0, 1, 2, 4, 3, 2, 1, 0, 3, 7, 8, 9], np.int32)
    assert walk_faces(numbers).tolist() == [0, 4, 9, 13]
    assert walk_faces(numbers[:-1])[-1] != len(numbers) - 1
    assert walk_faces(np.array([3, 0, 1, 2, 0, 5]))[-1] != 6
