"""Meshes of polyhedra given by their faces, and several meshes as one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.mesh.cells import (
    AnyFloats,
    CellMesh,
    Labels,
    Measures,
    PointMesh,
    Polyhedra,
    check_labels,
    sides_of_cells,
)
from cldit.errors import SprayError


@dataclass(frozen=True)
class Mesh(PointMesh):
    """Cells by their faces.

    points_m (P, 3); face f has the corners `corners[start[f]:start[f + 1]]`, ordered so that its
    normal points out of the cell `owner[f]` and into `neighbour[f]`, which is -1 on the boundary;
    `cells` is their number, `source` the file or folder that errors name.
    """

    points_m: AnyFloats
    corners: Labels
    start: Labels
    owner: Labels
    neighbour: Labels
    cells: int
    source: str

    def __post_init__(self) -> None:
        if self.cells < 1:
            raise SprayError(f"{self.source}: the mesh has no cell")
        if self.start[0] != 0 or self.start[-1] != len(self.corners):
            raise SprayError(f"{self.source}: the faces of the mesh do not use all of its corners")
        if np.diff(self.start).min(initial=3) < 3:
            raise SprayError(f"{self.source}: a face of the mesh has fewer than three corners")
        if len(self.owner) != len(self.start) - 1 or len(self.neighbour) != len(self.owner):
            raise SprayError(
                f"{self.source}: {len(self.owner)} owners for {len(self.start) - 1} faces"
            )
        for kind, labels, low, end in (
            ("point", self.corners, 0, len(self.points_m)),
            ("owner", self.owner, 0, self.cells),
            ("neighbour", self.neighbour, -1, self.cells),
        ):
            check_labels(self.source, kind, labels, low=low, end=end)
        _ = self.extent_m

    @cached_property
    def _sides(self) -> tuple[Labels, Labels]:
        """First side of each cell, and the sides of all cells, as in `Polyhedra`."""
        return sides_of_cells(self.owner, self.neighbour, self.cells)

    def corner_mean(self, values: AnyFloats) -> Floats:
        """Means (N,) of values (P,) at points over the distinct corners of each cell."""
        points, sizes = len(self.points_m), np.diff(self.start)
        pairs = np.repeat(self.owner, sizes).astype(np.int64) * points + self.corners
        beyond = np.repeat(self.neighbour, sizes).astype(np.int64)
        neighbour_pairs = (beyond * points + self.corners)[beyond >= 0]
        cell, point = np.divmod(np.unique(np.concatenate([pairs, neighbour_pairs])), points)
        total = np.bincount(cell, weights=values[point], minlength=self.cells)
        return np.asarray(total / np.bincount(cell, minlength=self.cells))

    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """Faces of `cells` (N,), all in one part."""
        cell_start, sides = self._sides
        faces = self.points_m, self.corners, self.start, cell_start, sides
        yield np.arange(len(cells)), Polyhedra(*faces, cells)


@dataclass(frozen=True)
class JoinedMesh(CellMesh):
    """Several meshes as one, cells in order; faces between them are double, which harms no sum."""

    parts: Sequence[CellMesh]

    @property
    def source(self) -> str:  # type: ignore[override]
        """Source of the first mesh."""
        return self.parts[0].source

    @cached_property
    def _ends(self) -> Labels:
        return np.cumsum([part.cells for part in self.parts])

    @property
    def cells(self) -> int:  # type: ignore[override]
        """Number of cells of all meshes."""
        return int(self._ends[-1])

    @property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the bounding box of all points."""
        lower, upper = zip(*(part.extent_m for part in self.parts), strict=True)
        return np.min(lower, axis=0), np.max(upper, axis=0)

    def points(self) -> Iterator[AnyFloats]:
        """All points of the meshes, (P, 3) of some at a time; those between meshes come twice."""
        for part in self.parts:
            yield from part.points()

    def measure(self, cells: Labels) -> Measures:
        """Volume, centroid and bounds of `cells` (N,), those of one mesh after the other."""
        measures = Measures.empty(len(cells))
        mesh = np.searchsorted(self._ends, cells, side="right")
        for number in np.unique(mesh).tolist():
            indices, part = np.flatnonzero(mesh == number), self.parts[number]
            measures.put(indices, part.measure(cells[indices] - (self._ends[number] - part.cells)))
        return measures


def mesh_of_sides(
    points_m: AnyFloats, corners: Labels, start: Labels, sides: Labels, cells: int, source: str
) -> Mesh:
    """Mesh of faces with normals out of the first and into the second of their `sides` (2, F).

    A negative side is none; a face without a first one is turned to belong to its second.
    """
    inside, outside = sides
    turned = inside < 0
    face = np.repeat(np.arange(len(turned)), np.diff(start))
    place = np.arange(len(corners))
    mirrored = (start[:-1] + start[1:] - 1)[face] - place
    corners = corners[np.where(turned[face], mirrored, place)]
    owner = np.where(turned, outside, inside)
    neighbour = np.where(turned | (outside < 0), np.int32(-1), outside)
    return Mesh(points_m, corners, start, owner, neighbour, cells, source)


def join(meshes: Sequence[CellMesh]) -> CellMesh:
    """Joins several meshes to one, cells in order."""
    return meshes[0] if len(meshes) == 1 else JoinedMesh(meshes)
