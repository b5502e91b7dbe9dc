"""Meshes of polyhedra given by their faces: volumes, centroids, and boxes that stand for cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cldit.errors import SprayError
from cldit.spray.result import Floats

Labels = NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """Cells by their faces.

    points_m (P, 3); face f has the corners `corners[start[f]:start[f + 1]]`, ordered so that its
    normal points out of the cell `owner[f]` and into `neighbour[f]`, which is -1 on the boundary;
    `cells` is the number of cells, `source` the file or folder to name in errors.
    """

    points_m: Floats
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
        for what, labels, low, end in (
            ("point", self.corners, 0, len(self.points_m)),
            ("owner", self.owner, 0, self.cells),
            ("neighbour", self.neighbour, -1, self.cells),
        ):
            if labels.size and (labels.min() < low or labels.max() >= end):
                raise SprayError(
                    f"{self.source}: {what} labels {labels.min()} to {labels.max()} of the faces, "
                    f"allowed is {low}..{end - 1}"
                )
        if not np.all(np.isfinite(self.points_m)) or np.abs(self.points_m).max() > 1e3:
            raise SprayError(f"{self.source}: a point of the mesh is not within +-1000 m")

    @cached_property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the mesh's bounding box, (3,) both."""
        return self.points_m.min(axis=0), self.points_m.max(axis=0)

    @cached_property
    def faces(self) -> tuple[Floats, Floats]:
        """Centre and area vector of each face, (F, 3) both, by triangles about the mean corner."""
        sizes = np.diff(self.start)
        here = self.points_m[self.corners]
        following = np.arange(1, len(self.corners) + 1)
        following[self.start[1:] - 1] = self.start[:-1]  # the last corner closes the polygon
        there = here[following]
        middle = np.repeat(
            np.add.reduceat(here, self.start[:-1], axis=0) / sizes[:, None], sizes, axis=0
        )
        triangle = 0.5 * np.cross(there - here, middle - here)
        area = np.add.reduceat(triangle, self.start[:-1], axis=0)
        # signed by the face's own normal, so that a notch in the polygon counts as one
        weight = np.einsum("ij,ij->i", triangle, np.repeat(area, sizes, axis=0))[:, None]
        total = np.add.reduceat(weight, self.start[:-1], axis=0)
        moment = np.add.reduceat(weight * (here + there + middle) / 3, self.start[:-1], axis=0)
        flat = total[:, 0] <= 0.0  # a face without area has no weight in any sum
        centre = np.where(flat[:, None], middle[self.start[:-1]], moment)
        centre[~flat] /= total[~flat]
        return centre, area

    @cached_property
    def _sides(self) -> tuple[Labels, Labels, Floats]:
        """Face, cell and sign of the face's normal, for each side of a face that has a cell."""
        inner = np.flatnonzero(self.neighbour >= 0)
        face = np.concatenate([np.arange(len(self.owner)), inner])
        cell = np.concatenate([self.owner, self.neighbour[inner]])
        sign = np.concatenate([np.ones(len(self.owner)), -np.ones(len(inner))])
        few = np.flatnonzero(np.bincount(cell, minlength=self.cells) < 4)
        if len(few):
            raise SprayError(f"{self.source}: cell {few[0]} has fewer than four faces")
        return face, cell, sign

    def _sum(self, values: Floats) -> Floats:
        """Sums of (S,) or (S, 3) values over the sides of each cell."""
        _, cell, _ = self._sides
        if values.ndim == 1:
            return np.asarray(np.bincount(cell, weights=values, minlength=self.cells), np.float64)
        columns = [np.bincount(cell, weights=column, minlength=self.cells) for column in values.T]
        return np.stack(columns, axis=1)

    @cached_property
    def volume_and_centroid(self) -> tuple[Floats, Floats]:
        """Volume (N,) and centroid (N, 3) of each cell, summed over pyramids on its faces.

        The pyramids meet in the mean of the face centres (as in OpenFOAM, primitiveMeshTools).

        Raises:
            SprayError: a cell has no volume, or its faces do not enclose it.
        """
        face, cell, sign = self._sides
        centre, area = self.faces
        # outward area vectors of a closed cell sum to nothing; the slack is for float32 points
        open_ = np.linalg.norm(self._sum(sign[:, None] * area[face]), axis=1)
        leaking = np.flatnonzero(open_ > 0.01 * self._sum(np.linalg.norm(area[face], axis=1)))
        if len(leaking):
            raise SprayError(
                f"{self.source}: the faces of cell {leaking[0]} do not enclose it, or do not all "
                "point outwards"
            )
        count = np.bincount(cell, minlength=self.cells)[:, None]
        tip = self._sum(centre[face]) / count
        from_tip = centre[face] - tip[cell]
        pyramid = sign * np.einsum("ij,ij->i", area[face], from_tip) / 3
        volume = self._sum(pyramid)
        # faces that all point inwards (some exporters) turn every sign: the cell is the same
        bad = np.flatnonzero(~(np.abs(volume) > 0.0))
        if len(bad):
            raise SprayError(f"{self.source}: cell {bad[0]} of the mesh has no volume")
        moment = self._sum(pyramid[:, None] * from_tip)
        return np.abs(volume), tip + 0.75 * moment / volume[:, None]

    @cached_property
    def bounds_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of each cell's bounding box, (N, 3) both."""
        face, cell, _ = self._sides
        order = np.argsort(cell, kind="stable")
        first = np.searchsorted(cell[order], np.arange(self.cells))
        corners = self.points_m[self.corners]
        lower = np.minimum.reduceat(corners, self.start[:-1])[face[order]]
        upper = np.maximum.reduceat(corners, self.start[:-1])[face[order]]
        return np.minimum.reduceat(lower, first), np.maximum.reduceat(upper, first)

    def boxes_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (N, 3) of a box for each cell.

        It has the volume and centroid of the cell and the proportions of its bounding box; for a
        cell that is a box along the axes it is that box.
        """
        volume, centroid = self.volume_and_centroid
        lower, upper = self.bounds_m
        half = (upper - lower) / 2
        half *= np.cbrt(volume / np.prod(upper - lower, axis=1))[:, None]
        return centroid - half, centroid + half

    def moved(self, *, origin_m: Floats, rotation: Floats) -> Mesh:
        """The mesh with `origin_m` as the origin, then turned by `rotation` (3, 3)."""
        points = (self.points_m - origin_m) @ rotation.T
        return Mesh(
            points, self.corners, self.start, self.owner, self.neighbour, self.cells, self.source
        )


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several, cells in order; faces between them stay double, which harms no sum."""
    if len(meshes) == 1:
        return meshes[0]
    points = np.cumsum([0, *(len(mesh.points_m) for mesh in meshes)])
    corners = np.cumsum([0, *(len(mesh.corners) for mesh in meshes)])
    cells = np.cumsum([0, *(mesh.cells for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.points_m for mesh in meshes]),
        np.concatenate([m.corners + shift for m, shift in zip(meshes, points, strict=False)]),
        np.concatenate(
            [[0], *(m.start[1:] + shift for m, shift in zip(meshes, corners, strict=False))]
        ),
        np.concatenate([m.owner + shift for m, shift in zip(meshes, cells, strict=False)]),
        np.concatenate(
            [
                np.where(m.neighbour < 0, -1, m.neighbour + shift)
                for m, shift in zip(meshes, cells, strict=False)
            ]
        ),
        int(cells[-1]),
        meshes[0].source,
    )


# Corners of a box's faces, normals outwards; bits 0, 1, 2 of a corner choose the upper x, y, z.
_BOX = np.array(
    [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
)


def box_mesh(lower_m: Floats, upper_m: Floats, source: str) -> Mesh:
    """A mesh of boxes that share no face.

    Args:
        lower_m, upper_m: (N, 3) corners.
        source: named by errors.
    """
    count = len(lower_m)
    bit = (np.arange(8)[:, None] >> np.arange(3)) & 1
    points = np.where(bit[None] == 1, upper_m[:, None], lower_m[:, None]).reshape(-1, 3)
    corners = (8 * np.arange(count)[:, None, None] + _BOX).reshape(-1)
    faces = 6 * count
    return Mesh(
        points_m=points,
        corners=corners,
        start=4 * np.arange(faces + 1),
        owner=np.repeat(np.arange(count), 6),
        neighbour=np.full(faces, -1, dtype=np.int64),
        cells=count,
        source=source,
    )
