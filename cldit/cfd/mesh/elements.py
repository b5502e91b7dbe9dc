"""Meshes of elements given by their corners, from tetrahedra to hexahedra, and of polyhedra."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.cfd.mesh.cells import (
    IN_CACHE,
    AnyFloats,
    CellMesh,
    Labels,
    Measures,
    PointMesh,
    Polyhedra,
    check_labels,
    checked_points,
    narrowed,
    slices,
)
from cldit.errors import SprayError

# Faces of vtk's linear cells, normals outwards (VTK file formats, figure "Linear cell types").
FACES: dict[int, tuple[tuple[int, ...], ...]] = {
    10: ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),  # tetrahedron
    # voxel: the points count up in x, then y, then z
    11: ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)),
    # hexahedron
    12: ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
    13: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),  # wedge
    14: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),  # pyramid
}
CORNERS = {kind: 1 + max(map(max, faces)) for kind, faces in FACES.items()}
POLYHEDRON = 42
# corners of a tetrahedron, voxel, hexahedron and wedge along three edges, and its share of the
# volume that these span; other cells of the kind have plane faces that are not parallel
_VOXEL = np.array([(n & 1, n >> 1 & 1, n >> 2) for n in range(8)])
_REGULAR = {
    10: (_VOXEL[[0, 1, 2, 4]], 1 / 6),
    11: (_VOXEL, 1.0),
    12: (_VOXEL[[0, 1, 3, 2, 4, 5, 7, 6]], 1.0),
    13: (_VOXEL[[0, 1, 2, 4, 5, 6]], 1 / 2),
}
_STRAIGHT = 1e-4  # of the height of a cell: such a miss of a corner changes its volume by 1e-8


def block_corners(shape: Sequence[int]) -> Labels:
    """Corners (N, 8) of the hexahedra of a block of (nx, ny, nz) nodes, x fastest."""
    corner = narrowed(np.arange(int(np.prod(shape)))).reshape(tuple(shape)[::-1])
    low, high = slice(None, -1), slice(1, None)
    ring = [(low, low), (low, high), (high, high), (high, low)]
    layers = [layer[:, y, x] for layer in (corner[:-1], corner[1:]) for y, x in ring]
    return np.stack(layers, axis=-1).reshape(-1, 8)


def elements(points_m: AnyFloats, kind: int, nodes: Labels) -> Polyhedra:
    """Elements of one `kind` of `FACES` as polyhedra; points_m (P, 3), nodes (N, corners)."""
    faces = FACES[kind]
    order = np.array([corner for face in faces for corner in face])
    ends = np.cumsum([len(face) for face in faces])
    count = len(nodes)
    start = np.zeros(count * len(faces) + 1, np.int64)
    start[1:] = (np.arange(count)[:, None] * ends[-1] + ends).reshape(-1)
    return Polyhedra(
        points_m=points_m,
        corners=nodes[:, order].reshape(-1).astype(np.int32),
        start=start,
        first=np.arange(count + 1) * len(faces),
        sides=np.arange(count * len(faces), dtype=np.int32),
        members=np.arange(count),
    )


@dataclass(frozen=True)
class ElementMesh(PointMesh):
    """Cells by their corners.

    points_m (P, 3); cell c is of vtk's type `kinds[c]` and has the corners
    `nodes[offsets[c]:offsets[c + 1]]`, in vtk's order; those of type `POLYHEDRON` are in `solids`,
    in which other cells have no sides; all normals point outwards.
    """

    points_m: AnyFloats
    kinds: NDArray[np.integer]
    offsets: Labels
    nodes: Labels
    source: str
    solids: Polyhedra | None = None

    def __post_init__(self) -> None:
        if not len(self.kinds):
            raise SprayError(f"{self.source}: the mesh has no cell")
        _ = self.extent_m
        check_labels(self.source, "point", self.nodes, low=0, end=len(self.points_m))
        sizes = np.diff(self.offsets)
        if len(sizes) != self.cells or self.offsets[0] != 0 or self.offsets[-1] != len(self.nodes):
            raise SprayError(f"{self.source}: the cells of the mesh do not use all of its corners")
        for kind in self._kinds(self.kinds):
            if kind == POLYHEDRON and self.solids is not None:
                self._check_polyhedra(self.solids)
            elif kind not in FACES:
                cell = int(np.argmax(self.kinds == kind))
                raise SprayError(
                    f"{self.source}: cell {cell} is of vtk type {kind}; allowed: tetrahedra, "
                    "hexahedra, voxels, wedges, pyramids, polyhedra"
                )
            elif np.any((self.kinds == kind) & (sizes != CORNERS[kind])):
                cell = int(np.argmax((self.kinds == kind) & (sizes != CORNERS[kind])))
                problem = f"cell {cell} of vtk type {kind} has {sizes[cell]} corners"
                raise SprayError(f"{self.source}: {problem}, expected {CORNERS[kind]}")
        if sizes.min() < 0:
            raise SprayError(f"{self.source}: a cell of the mesh has fewer than no corners")

    def _kinds(self, kinds: NDArray[np.integer]) -> list[int]:
        uniform = self.kinds.strides == (0,)  # repeated, without being stored
        return [int(kind) for kind in (kinds[:1] if uniform else np.unique(kinds))]

    def _check_polyhedra(self, solid: Polyhedra) -> None:
        check_labels(self.source, "point", solid.corners, low=0, end=len(self.points_m))
        check_labels(self.source, "face", solid.sides, low=0, end=len(solid.start) - 1)
        ends = solid.start[-1] == len(solid.corners) and solid.first[-1] == len(solid.sides)
        corners, faces = np.diff(solid.start), np.diff(solid.first)
        rising = corners.min(initial=3) >= 3 and faces.min(initial=0) >= 0
        if not (ends and rising and len(faces) == self.cells):
            raise SprayError(f"{self.source}: the faces of the polyhedra do not fit their cells")

    @property
    def cells(self) -> int:  # type: ignore[override]
        """Number of cells."""
        return len(self.kinds)

    def corner_mean(self, values: AnyFloats) -> Floats:
        """Means (N,) of values (P,) at points over the corners of each cell."""
        sums = np.add.reduceat(values[self.nodes], self.offsets[:-1], dtype=np.float64)
        return np.asarray(sums / np.diff(self.offsets))

    def measure(self, cells: Labels) -> Measures:
        """Volume, centroid and bounds of `cells` (N,); by their faces if they are not regular."""
        measures, rest = Measures.empty(len(cells)), np.ones(len(cells), dtype=bool)
        kinds = self.kinds[cells]
        for kind in set(self._kinds(kinds)) & set(_REGULAR):
            of_kind = np.flatnonzero(kinds == kind)
            for begin in range(0, len(of_kind), IN_CACHE):
                place = of_kind[begin : begin + IN_CACHE]
                corner = self.offsets[cells[place]] + np.arange(CORNERS[kind])[:, None]
                regular, values = _regular(kind, self.points_m[self.nodes[corner]])
                measures.put(place, values)
                rest[place] = ~regular
        if rest.any():
            measures.put(np.flatnonzero(rest), super().measure(cells[rest]))
        return measures

    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """Faces of `cells` (N,), one kind after the other."""
        kinds = self.kinds[cells]
        for kind in self._kinds(kinds):
            indices = np.flatnonzero(kinds == kind)
            if kind == POLYHEDRON:
                assert self.solids is not None
                yield indices, replace(self.solids, members=cells[indices])
            else:
                corner = self.offsets[cells[indices], None] + np.arange(CORNERS[kind])
                yield indices, elements(self.points_m, kind, self.nodes[corner])


def _regular(kind: int, corners_m: AnyFloats) -> tuple[Mask, Measures]:
    """Measures of the cells of corners_m (n, N, 3), and which are regular (N,).

    A regular cell has straight and parallel edges, by least squares through its corners; its
    centroid is their mean. A miss of `_STRAIGHT` changes the volume by its square.
    """
    along, share = _REGULAR[kind]
    basis = np.column_stack([np.ones(len(along)), along])
    flat = corners_m.reshape(len(along), -1).astype(np.float64)
    fit = np.linalg.pinv(basis) @ flat
    miss = np.abs(flat - basis @ fit).max(axis=0).reshape(-1, 3).T.max(axis=0)
    edges = fit[1:].reshape(3, -1, 3)
    volume = np.abs(np.einsum("ij,ij->i", edges[0], np.cross(edges[1], edges[2])))
    lengths = np.sqrt(np.einsum("eij,eij->ei", edges, edges))
    height = volume * lengths.min(axis=0) / np.maximum(lengths.prod(axis=0), 1e-300)
    places = (values.reshape(-1, 3) for values in (flat.mean(0), flat.min(0), flat.max(0)))
    return (miss <= _STRAIGHT * height) & (volume > 0.0), Measures(share * volume, *places)


@dataclass(frozen=True)
class BoxMesh(CellMesh):
    """Boxes along the axes, lower_m and upper_m (N, 3), that share no face."""

    lower_m: Floats
    upper_m: Floats
    source: str

    def __post_init__(self) -> None:
        if not self.cells:
            raise SprayError(f"{self.source}: the mesh has no cell")
        _ = self.extent_m

    @property
    def cells(self) -> int:  # type: ignore[override]
        """Number of cells."""
        return len(self.lower_m)

    @cached_property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the bounding box of all points."""
        lower, _ = checked_points(self.source, self.lower_m)
        _, upper = checked_points(self.source, self.upper_m)
        return lower, upper

    def measure(self, cells: Labels) -> Measures:
        """Volume, centroid and bounds of `cells` (N,)."""
        lower, upper = self.lower_m[cells], self.upper_m[cells]
        return Measures((upper - lower).prod(axis=1), (lower + upper) / 2, lower, upper)

    def points(self) -> Iterator[AnyFloats]:
        """Corners of all boxes, (P, 3) of some at a time."""
        for part in slices(self.cells):
            lower, upper = self.lower_m[part, None], self.upper_m[part, None]
            yield np.where(_VOXEL == 1, upper, lower).reshape(-1, 3)
