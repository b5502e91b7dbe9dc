"""The geometry file of an EnSight Gold case: unstructured parts and blocks."""

from __future__ import annotations

import numpy as np

from cldit.cfd.ensight.file import Reader
from cldit.cfd.ensight.variable import Part, Parts
from cldit.cfd.mesh import Labels, Mesh
from cldit.cfd.vtk.datasets import FACES
from cldit.spray.result import Floats

_CORNERS = {"tetra4": 4, "pyramid5": 5, "penta6": 6, "hexa8": 8}
_FLAT = {"point": 1, "bar2": 2, "bar3": 3, "tria3": 3, "tria6": 6, "quad4": 4, "quad8": 8}
_VTK = {"tetra4": 10, "pyramid5": 14, "penta6": 13, "hexa8": 12}

Faces = tuple[Labels, Labels, Labels]  # corners, sizes and owners


def read_geometry(file: Reader) -> tuple[Parts, Mesh, int]:
    """The parts with their elements in order, the mesh of all solid ones, and cells left out.

    Those that are left out are ghosts, and cells of blocks with a blanked corner.

    Raises:
        SprayError: the file is damaged, or holds what is not read.
    """
    file.text()
    file.text()
    flags = [file.text().split()[-1] for _ in range(2)]
    named_nodes, named_elements = (flag in ("given", "ignore") for flag in flags)
    parts: Parts = {}
    points: list[Floats] = []
    faces: list[Faces] = []
    offset = cells = hidden = 0
    line = file.text()
    if line == "extents":
        file.floats(6, a_line=2)
        line = file.text()
    while line == "part":
        number = file.part_number()
        if number in parts:
            raise file.fail(f"holds part {number} twice")
        file.text()
        kind = file.text()
        if kind.split()[:1] == ["block"]:
            places, corners, kept = _block(file, kind.split()[1:], number)
            place = np.where(kept, np.cumsum(kept) - 1 + cells, -1)
            parts[number] = Part(offset, len(places), [("block", len(kept), place)])
            points.append(places)
            found = _hexahedra(corners[kept])
            faces.append((found[0] + offset, found[1], found[2] + cells))
            cells += int(kept.sum())
            hidden += int((~kept).sum())
            line = "" if file.done else file.text()
            offset += len(places)
            continue
        if kind != "coordinates":
            raise file.fail(f"part {number} is {kind!r}; unstructured parts and blocks are read")
        count = int(file.integers(1)[0])
        if named_nodes:
            file.integers(count)
        points.append(file.floats(3 * count).reshape(3, count).T)
        parts[number] = Part(offset, count)
        line = "" if file.done else file.text()
        while line not in ("", "part"):
            ghost, kind = line.startswith("g_"), line.removeprefix("g_")
            many = int(file.integers(1)[0])
            if named_elements:
                file.integers(many)
            solid = _elements(file, kind, many)
            place = np.full(many, -1)
            if solid is not None and ghost:
                hidden += many
            elif solid is not None:
                corner, sizes, owner = solid
                if corner.size and (corner.min() < 1 or corner.max() > count):
                    raise file.fail(f"part {number}: {kind} with nodes outside 1..{count}")
                faces.append((corner - 1 + offset, sizes, owner + cells))
                place = np.arange(cells, cells + many)
                cells += many
            parts[number].elements.append((line, many, place))
            line = "" if file.done else file.text()
        offset += count
    if line:
        raise file.fail(f"{line!r} where a part is expected; the file is damaged")
    if not cells:
        raise file.fail("the mesh has no solid cell")
    size = np.concatenate([part[1] for part in faces])
    mesh = Mesh(
        points_m=np.concatenate(points),
        corners=np.concatenate([part[0] for part in faces]),
        start=np.concatenate([[0], np.cumsum(size)]),
        owner=np.concatenate([part[2] for part in faces]),
        neighbour=np.full(len(size), -1, dtype=np.int64),
        cells=cells,
        source=str(file.path),
    )
    return parts, mesh, hidden


def _hexahedra(nodes: Labels) -> Faces:
    """Faces of hexahedra with the corners (N, 8)."""
    return _faces(nodes, FACES[12])


def _faces(nodes: Labels, around: tuple[tuple[int, ...], ...]) -> Faces:
    corners = [nodes[:, list(face)].reshape(-1) for face in around]
    sizes = np.repeat([len(face) for face in around], len(nodes))
    return np.concatenate(corners), sizes, np.tile(np.arange(len(nodes)), len(around))


def _elements(file: Reader, kind: str, many: int) -> Faces | None:
    """Faces of solid elements; None for flat ones."""
    if kind in _FLAT:
        file.integers(many * _FLAT[kind], a_line=_FLAT[kind])
        return None
    if kind == "nsided":
        _ragged(file, file.integers(many))
        return None
    if kind == "nfaced":
        faces = file.integers(many)
        sizes = file.integers(int(faces.sum()))
        return _ragged(file, sizes), sizes, np.repeat(np.arange(many), faces)
    if kind not in _CORNERS:
        raise file.fail(f"elements of type {kind!r} are not read; write linear ones")
    nodes = file.integers(many * _CORNERS[kind], a_line=_CORNERS[kind]).reshape(many, -1)
    return _faces(nodes, FACES[_VTK[kind]])


def _ragged(file: Reader, sizes: Labels) -> Labels:
    if file.binary:
        return file.integers(int(sizes.sum()))
    rows = [file.integers(int(size), a_line=int(size)) for size in sizes]
    return np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)


def _block(file: Reader, words: list[str], number: int) -> tuple[Floats, Labels, Labels]:
    """Points (P, 3), corners of its cells (N, 8), and which cells are not blanked (N,)."""
    shape = [int(n) for n in file.integers(3, a_line=3)]
    allowed = {"curvilinear", "rectilinear", "uniform", "iblanked"}
    if extra := set(words) - allowed:
        raise file.fail(
            f"part {number} is a block {min(extra)!r}; allowed are {', '.join(sorted(allowed))}"
        )
    if min(shape) < 2:
        raise file.fail(f"part {number} is a block of {shape} nodes, expected 2 or more each way")
    count = int(np.prod(shape))
    if "rectilinear" in words:
        edges = [file.floats(size) for size in shape]
    elif "uniform" in words:
        origin, delta = file.floats(3), file.floats(3)
        edges = [o + d * np.arange(n) for o, d, n in zip(origin, delta, shape, strict=True)]
    if {"rectilinear", "uniform"} & set(words):
        z, y, x = np.meshgrid(*edges[::-1], indexing="ij")
        points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    else:
        points = file.floats(3 * count).reshape(3, count).T
    shown = file.integers(count) != 0 if "iblanked" in words else np.ones(count, dtype=bool)
    corner = np.arange(count).reshape(shape[::-1])
    low, high = slice(None, -1), slice(1, None)
    ring = [(low, low), (low, high), (high, high), (high, low)]
    layers = [layer[:, y, x] for layer in (corner[:-1], corner[1:]) for y, x in ring]
    nodes = np.stack(layers, axis=-1).reshape(-1, 8)
    return points, nodes, np.asarray(shown[nodes].all(axis=1))
