"""Geometry and variables of an EnSight Gold case: parts, blocks, values per element and node."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.cfd.case import Column
from cldit.cfd.ensight.file import Reader
from cldit.cfd.mesh.cells import AnyFloats, CellMesh, Labels
from cldit.cfd.mesh.elements import CORNERS, ElementMesh, block_corners
from cldit.cfd.mesh.faces import Mesh, join


@dataclass(frozen=True)
class Elements:
    """Elements of one type in a row, `count` of them; or the nodes of a part.

    first: cell of the mesh that the first element is; None if they are no cells (flat, ghost).
    kept: mask of those that are not blanked, of the shape (count,); None for all.
    """

    kind: str
    count: int
    first: int | None
    kept: NDArray[np.bool_] | None = None

    @property
    def cells(self) -> int:
        """Number of cells among them."""
        if self.first is None:
            return 0
        return self.count if self.kept is None else int(np.count_nonzero(self.kept))

    def of_cells(self, values: NDArray[Any]) -> NDArray[Any]:
        """Selects the values, of the shape (count,), that belong to cells."""
        return values if self.kept is None else values[self.kept]


Parts = dict[int, list[Elements]]
"""Parts of a geometry by number: their nodes among those of all parts, then their elements."""
Block = tuple[ElementMesh | Mesh, int]
"""Cells of one part and type, and the index of their first point among those of all parts."""


def read_variable(file: Reader, parts: Parts, count: int, label: str, *, at_nodes: bool) -> Column:
    """Field (count,) at all nodes or in all cells; nodes without a value are undefined."""
    values: AnyFloats = np.zeros(count, np.float64 if at_nodes else np.float32)
    missed, undefined = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    file.text()
    line = file.text(end=True)
    while line == "part":
        number = int(file.integers(1)[0])
        if number not in parts:
            raise file.fail(f"part {number} is not in the geometry")
        line = file.text(end=True)
        for elements in parts[number][:1] if at_nodes else parts[number][1:]:
            name, _, mode = line.partition(" ")
            if name != elements.kind:
                continue  # a type may be missing; if it has cells, an error follows below
            numbers, defined = _values(file, elements.count, mode.strip())
            if elements.first is not None:
                place = slice(elements.first, elements.first + elements.cells)
                values[place] = elements.of_cells(numbers)
                missed[place] = False
                undefined[place] = ~elements.of_cells(defined)
            line = file.text(end=True)
    if line:
        location = "nodes" if at_nodes else "elements"
        raise file.fail(f"{line!r} where a part or its {location} are expected")
    if missed.any() and not at_nodes:
        raise file.fail(f"no value for {int(missed.sum())} of {count} cells; truncated?")
    undefined |= missed
    return Column(label, values, undefined if undefined.any() else None)


def _values(file: Reader, size: int, mode: str) -> tuple[AnyFloats, NDArray[np.bool_]]:
    """Values (size,), and a mask of those that are defined."""
    if mode == "undef":
        mark = file.floats(1)[0]
        numbers = file.floats(size)
        return numbers, np.asarray(numbers != mark)
    if mode == "partial":
        count = int(file.integers(1)[0])
        place = file.integers(count) - 1
        if count and (place.min() < 0 or place.max() >= size or len(set(place.tolist())) < count):
            raise file.fail(f"partial values for elements outside 1..{size}, or twice for one")
        values, defined = np.zeros(size), np.zeros(size, dtype=bool)
        values[place], defined[place] = file.floats(count), True
        return values, defined
    if mode:
        raise file.fail(f"values of kind {mode!r}; allowed: plain, `undef` and `partial`")
    return file.floats(size), np.ones(size, dtype=bool)


def corner_mean(blocks: Sequence[Block], values: AnyFloats) -> Floats:
    """Means (N,) of values (P,) at all parts' points over the distinct corners of each cell."""
    return np.concatenate([_mean(mesh, values[first_node:]) for mesh, first_node in blocks])


def _mean(mesh: ElementMesh | Mesh, values: AnyFloats) -> Floats:
    if isinstance(mesh, ElementMesh):  # of one type
        nodes = np.sort(mesh.nodes.reshape(mesh.cells, -1), axis=1)
        new = np.ones(nodes.shape, dtype=bool)
        new[:, 1:] = nodes[:, 1:] != nodes[:, :-1]
        return np.asarray((values[nodes] * new).sum(axis=1) / new.sum(axis=1))
    return mesh.corner_mean(values)


_FLAT = {"point": 1, "bar2": 2, "bar3": 3, "tria3": 3, "tria6": 6, "quad4": 4, "quad8": 8}
_VTK = {"tetra4": 10, "pyramid5": 14, "penta6": 13, "hexa8": 12}


@dataclass
class Geometry:
    """Content of a geometry file, or of its parts so far.

    parts: nodes and elements of each, in order; blocks: meshes of solid cells, in order; cells,
    points: numbers in all parts; hidden: number of omitted cells: ghosts, and cells of blocks with
    a blanked corner.
    """

    parts: Parts = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    cells: int = 0
    points: int = 0
    hidden: int = 0

    @property
    def mesh(self) -> CellMesh:
        """Mesh of all blocks."""
        return join([mesh for mesh, _ in self.blocks])


def read_geometry(file: Reader) -> Geometry:
    """Reads all parts."""
    file.text()
    file.text()
    ids = [_ids_given(file, kind) for kind in ("node", "element")]
    read = Geometry()
    line = file.text()
    if line == "extents":
        file.floats(6, a_line=2)
        line = file.text()
    while line == "part":
        number = file.part_number()
        if number in read.parts:
            raise file.fail(f"has part {number} twice")
        file.text()
        kind = file.text()
        if kind.split()[:1] == ["block"]:
            line = _add_structured(file, read, number, kind.split()[1:])
        elif kind == "coordinates":
            line = _add_unstructured(file, read, number, *ids)
        else:
            raise file.fail(f"part {number} is {kind!r}; unstructured parts and blocks are read")
    if line:
        raise file.fail(f"{line!r} where a part is expected; the file is damaged")
    if not read.cells:
        raise file.fail("the mesh has no solid cell")
    return read


def _add_structured(file: Reader, read: Geometry, number: int, words: list[str]) -> str:
    """Adds a block, and returns the line that follows it."""
    places, corners, kept = _structured(file, words, number)
    elements = Elements("block", len(kept), read.cells, None if kept.all() else kept)
    read.parts[number] = [Elements("block", len(places), read.points), elements]
    if size := elements.cells:
        mesh = _solid(file, places, "hexa8", size, (corners[kept].reshape(-1),))
        read.blocks.append((mesh, read.points))
    read.cells += size
    read.hidden += len(kept) - size
    read.points += len(places)
    return file.text(end=True)


def _add_unstructured(
    file: Reader, read: Geometry, number: int, named_nodes: bool, named_elements: bool
) -> str:
    """Adds a part of elements, which may have ids, and returns the line that follows it."""
    count = int(file.integers(1)[0])
    if named_nodes:
        file.integers(count)
    points = np.ascontiguousarray(file.floats(3 * count).reshape(3, count).T)
    read.parts[number] = [Elements("coordinates", count, read.points)]
    line = file.text(end=True)
    while line not in ("", "part"):
        ghost, kind = line.startswith("g_"), line.removeprefix("g_")
        size = int(file.integers(1)[0])
        if named_elements:
            file.integers(size)
        connectivity = _elements(file, kind, size)
        kept = connectivity is not None and not ghost
        read.parts[number].append(Elements(line, size, read.cells if kept else None))
        if connectivity is not None and ghost:
            read.hidden += size
        elif connectivity is not None:
            nodes = connectivity[0]
            if nodes.size and (nodes.min() < 1 or nodes.max() > count):
                raise file.fail(f"part {number}: {kind} with nodes outside 1..{count}")
            if size:
                nodes -= 1
                read.blocks.append((_solid(file, points, kind, size, connectivity), read.points))
            read.cells += size
        line = file.text(end=True)
    read.points += count
    return line


def _ids_given(file: Reader, kind: str) -> bool:
    """True if ids of the nodes or elements follow, by a line such as `node id assign`."""
    line = file.text()
    mode = line.lower().rpartition(" ")[2]
    if mode not in ("off", "given", "assign", "ignore"):
        raise file.fail(f"{line!r}, expected `{kind} id` and off, given, assign or ignore")
    return mode in ("given", "ignore")


def _solid(
    file: Reader, points: AnyFloats, kind: str, count: int, connectivity: tuple[Labels, ...]
) -> ElementMesh | Mesh:
    """Mesh of `count` elements of one kind, as `_elements` returns them, but with nodes from 0."""
    source, nodes = str(file.path), connectivity[0]
    if kind == "nfaced":
        sizes, faces = connectivity[1:]
        start = np.concatenate([[0], np.cumsum(sizes)])
        owner = np.repeat(np.arange(count), faces)
        return Mesh(points, nodes, start, owner, np.full(len(owner), -1), count, source)
    kinds = np.broadcast_to(np.uint8(_VTK[kind]), count)
    return ElementMesh(points, kinds, np.arange(count + 1) * CORNERS[_VTK[kind]], nodes, source)


def _elements(file: Reader, kind: str, count: int) -> tuple[Labels, ...] | None:
    """Nodes of solid elements, from 1; for polyhedra also sizes of faces, and faces a cell.

    None for flat elements.
    """
    if kind in _FLAT:
        file.integers(count * _FLAT[kind], a_line=_FLAT[kind])
        return None
    if kind == "nsided":
        _ragged(file, file.integers(count))
        return None
    if kind == "nfaced":
        faces = file.integers(count)
        sizes = file.integers(int(faces.sum()))
        return _ragged(file, sizes), sizes, faces
    if kind not in _VTK:
        raise file.fail(f"elements of type {kind!r} are not read; write linear ones")
    corners = CORNERS[_VTK[kind]]
    return (file.integers(count * corners, a_line=corners),)


def _ragged(file: Reader, sizes: Labels) -> Labels:
    if file.binary:
        return file.integers(int(sizes.sum()))
    rows = [file.integers(int(size), a_line=int(size)) for size in sizes]
    return np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)


def _structured(file: Reader, words: list[str], number: int) -> tuple[AnyFloats, Labels, Mask]:
    """Points (P, 3), corners of the cells (N, 8), and a mask of those not blanked (N,)."""
    shape = [int(n) for n in file.integers(3, a_line=3)]
    allowed = {"curvilinear", "rectilinear", "uniform", "iblanked"}
    if extra := set(words) - allowed:
        kinds = ", ".join(sorted(allowed))
        raise file.fail(f"part {number} is a block {min(extra)!r}; allowed: {kinds}")
    if min(shape) < 2:
        raise file.fail(f"part {number} is a block of {shape} nodes, expected 2 or more each way")
    count = int(np.prod(shape))
    if {"rectilinear", "uniform"} & set(words):
        if "rectilinear" in words:
            edges = [file.floats(size) for size in shape]
        else:
            origin, delta = file.floats(3), file.floats(3)
            edges = [o + d * np.arange(n) for o, d, n in zip(origin, delta, shape, strict=True)]
        z, y, x = np.meshgrid(*edges[::-1], indexing="ij")
        points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    else:
        points = np.ascontiguousarray(file.floats(3 * count).reshape(3, count).T)
    shown = file.integers(count) != 0 if "iblanked" in words else np.ones(count, dtype=bool)
    nodes = block_corners(shape)
    return points, nodes, np.asarray(shown[nodes].all(axis=1))
