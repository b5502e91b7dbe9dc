"""Meshes as the importer needs them: volume, centroid and bounds of cells, some at a time.

A face is split into triangles about its mean corner, a cell into pyramids that meet in the mean of
its face centres (as in OpenFOAM, primitiveMeshTools::makeCellCentresAndVols). Coordinates come
first in arrays of faces, and faces or cells last, which numpy is fastest with.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cldit.arrays import Floats, Ints
from cldit.errors import SprayError

AnyFloats = NDArray[np.floating]
Labels = NDArray[np.signedinteger]

FEW_FACES, OPEN, NO_VOLUME = 1, 2, 3
_FAULTS = {
    FEW_FACES: "cell {} has fewer than four faces",
    OPEN: "the faces of cell {} do not enclose it, or do not all point outwards",
    NO_VOLUME: "cell {} of the mesh has no volume",
}
_OPEN = 0.01  # share of a cell's surface that may be missing; the slack is for float32 points
IN_CACHE = 8_000  # sides or cells at a time: (3, N) doubles take 0.2 MB, and all stay in the cache


@dataclass(frozen=True)
class Polyhedra:
    """Cells by their faces, as `measured_parts` takes them.

    points_m (P, 3); face f has the corners `corners[start[f]:start[f + 1]]`; cell c has the sides
    `sides[first[c]:first[c + 1]]`: f if the normal of face f points out of the cell, -1 - f if it
    points into the cell; `members` (N,) are the selected cells.
    """

    points_m: AnyFloats
    corners: Labels
    start: Labels
    first: Labels
    sides: Labels
    members: Labels


def _polygons(points_m: AnyFloats, corners: Labels) -> Floats:
    """Centre, area vector, bounds low and high, (4, 3, F), of polygons by their corners (n, F)."""
    count = len(corners)
    ring = np.empty((3, count + 1, corners.shape[1]))  # the first corner comes last again
    corner, following = ring[:, :-1], ring[:, 1:]
    corner[:] = points_m[corners].transpose(2, 0, 1)
    low, high = corner.min(axis=1), corner.max(axis=1)
    middle = corner.sum(axis=1) / count
    corner -= middle[:, None]
    ring[:, -1] = ring[:, 0]
    triangles = np.empty((3, count, corners.shape[1]))  # twice their areas
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        np.multiply(corner[j], following[k], out=triangles[axis])
        triangles[axis] -= corner[k] * following[j]
    area = triangles.sum(axis=1)
    # each triangle signed by the face's own normal: a notch in the polygon counts as one
    weight = np.einsum("acf,af->cf", triangles, area)
    total = weight.sum(axis=0)
    moment = np.einsum("acf,cf->af", corner + following, weight)
    # a face without area has no weight in any sum
    flat = ~(total > 0.0)
    middle += np.where(flat, 0.0, moment / np.where(flat, 1.0, 3.0 * total))
    return np.stack([middle, 0.5 * area, low, high])


def _faces(part: Polyhedra, faces: Labels) -> Floats:
    """Faces (F,) of a mesh as `_polygons` has them; those of as many corners together."""
    begin, size = part.start[faces], part.start[faces + 1] - part.start[faces]
    polygons = np.empty((4, 3, len(faces)))
    for kind in np.flatnonzero(np.bincount(size)).tolist():
        indices = np.flatnonzero(size == kind)
        corners = part.corners[begin[indices] + np.arange(kind)[:, None]]
        group = _polygons(part.points_m, corners)
        if len(indices) == len(faces):
            return group
        polygons[:, :, indices] = group
    return polygons


@dataclass(frozen=True)
class Measures:
    """Volume volume_m3 (N,), centroid_m and bounds lower_m, upper_m (N, 3) of each cell."""

    volume_m3: Floats
    centroid_m: Floats
    lower_m: Floats
    upper_m: Floats

    @classmethod
    def empty(cls, count: int) -> Measures:
        """Room for those of so many cells."""
        return cls(np.empty(count), *(np.empty((count, 3)) for _ in range(3)))

    def put(self, place: Ints, measures: Measures) -> None:
        """Sets the measures of the cells at `place` (N,)."""
        for values, part in zip(vars(self).values(), vars(measures).values(), strict=True):
            values[place] = part


def measured_parts(part: Polyhedra) -> Iterator[tuple[Ints, NDArray[np.int8], Measures]]:
    """Indices of some members of `part`, their faults (0: none) and their measures."""
    cell_start, members = part.first, part.members
    begin = cell_start[members].astype(np.int64)
    count = cell_start[members + 1] - begin
    short, closed = np.flatnonzero(count < 4), np.flatnonzero(count >= 4)
    if short.size:
        none = np.zeros((short.size, 3))
        yield short, np.full(short.size, FEW_FACES, np.int8), Measures(none[:, 0], none, none, none)
    ends = np.cumsum(count[closed])
    done = 0
    while done < len(closed):
        past = ends[done - 1] if done else 0
        stop = max(done + 1, int(np.searchsorted(ends, past + IN_CACHE, "right")))
        chosen = closed[done:stop]
        sizes, at = count[chosen], ends[done:stop] - count[chosen] - past
        side = part.sides[np.repeat(begin[chosen] - at, sizes) + np.arange(ends[stop - 1] - past)]
        outward = side >= 0
        # most faces are those of two cells
        distinct, of_side = np.unique(np.where(outward, side, -1 - side), return_inverse=True)
        faces = np.take(_faces(part, distinct), of_side, axis=2)
        faces[1][:, ~outward] *= -1.0
        yield chosen, *_cells(faces, sizes, at)
        done = stop


def _cells(faces: Floats, count: Ints, at: Ints) -> tuple[NDArray[np.int8], Measures]:
    """Measures cells of so many faces (N,), of which the first ones are `at`; faces (4, 3, F)."""
    centre, area, lowest, highest = faces
    surface = np.add.reduceat(np.sqrt(np.sum(area * area, axis=0)), at)
    # outward area vectors of a closed cell sum to nothing
    missing = np.sqrt(np.sum(np.add.reduceat(area, at, axis=1) ** 2, axis=0))
    tip = np.add.reduceat(centre, at, axis=1) / count
    offset = centre - np.repeat(tip, count, axis=1)
    pyramid = np.sum(area * offset, axis=0) / 3.0
    volume = np.add.reduceat(pyramid, at)
    fault = np.where(np.abs(volume) > 0.0, 0, NO_VOLUME)
    fault = np.where(missing > _OPEN * surface, OPEN, fault).astype(np.int8)
    shift = np.add.reduceat(pyramid * offset, at, axis=1) / np.where(fault > 0, 1.0, volume)
    # faces that all point inwards (some exporters) turn every sign: the cell is the same
    middle = (tip + 0.75 * shift).T
    low, high = (
        np.minimum.reduceat(lowest, at, axis=1),
        np.maximum.reduceat(highest, at, axis=1),
    )
    return fault, Measures(np.abs(volume), middle, low.T, high.T)


def sides_of_cells(owner: Labels, neighbour: Labels, cells: int) -> tuple[Labels, Labels]:
    """First side of each cell, and the sides of all cells, as in `Polyhedra`.

    owner, neighbour: (F,) of each face; a neighbour of -1 is none.
    """
    inner = np.flatnonzero(neighbour >= 0).astype(np.int32)
    cell = np.concatenate([owner, neighbour[inner]]).astype(np.int32)
    side = np.concatenate([np.arange(len(owner), dtype=np.int32), -1 - inner])
    # A matrix with one entry a row; its transpose has them sorted by cell, in two passes.
    rows = np.arange(len(side) + 1, dtype=np.int32)
    by_cell = csr_array((side, cell, rows), shape=(len(side), cells)).tocsc()
    return by_cell.indptr, by_cell.data


def walk_faces(numbers: Labels) -> Ints:
    """Finds faces that are stored one after the other, each as its size and its corners.

    Returns the index of each face's size, and the end of the last face (F + 1,), which is not
    `len(numbers)` if the numbers are no such list.
    """
    sizes, place, at = np.ascontiguousarray(numbers).data, array("q", [0]), 0
    while at < len(numbers):
        size = sizes[at]
        if size < 1:
            break
        at += 1 + size
        place.append(at)
    return np.array(place, np.int64)


AT_ONCE = 50_000  # cells; some 600 bytes a cell are in work


class CellMesh(ABC):
    """Mesh of `cells` cells; `source` is the file or folder that errors name."""

    source: str
    cells: int

    @property
    @abstractmethod
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the bounding box of all points."""

    @abstractmethod
    def points(self) -> Iterator[AnyFloats]:
        """All points of the mesh, (P, 3) of some at a time; a point may come twice."""

    @abstractmethod
    def measure(self, cells: Labels) -> Measures:
        """Volume, centroid and bounds of `cells` (N,)."""


class PointMesh(CellMesh):
    """Mesh whose points (P, 3) are in memory."""

    points_m: AnyFloats

    @abstractmethod
    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """Faces of `cells` (N,), in parts: indices into `cells`, and the polyhedra of these."""

    def measure(self, cells: Labels) -> Measures:
        """Volume, centroid and bounds of `cells` (N,), by their faces."""
        measures = Measures.empty(len(cells))
        for place, part in self.polyhedra(cells):
            for chosen, fault, values in measured_parts(part):
                indices = place[chosen]
                if fault.any():
                    bad = int(np.flatnonzero(fault)[0])
                    message = _FAULTS[fault[bad]].format(cells[indices[bad]])
                    raise SprayError(f"{self.source}: {message}")
                measures.put(indices, values)
        return measures

    @cached_property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the bounding box of all points."""
        return checked_points(self.source, self.points_m)

    def points(self) -> Iterator[AnyFloats]:
        """All points of the mesh, (P, 3) of some at a time."""
        for part in slices(len(self.points_m)):
            yield self.points_m[part]


def slices(count: int) -> Iterator[slice]:
    """Ranges of at most `AT_ONCE` that cover `count`."""
    for begin in range(0, count, AT_ONCE):
        yield slice(begin, min(begin + AT_ONCE, count))


def narrowed(numbers: NDArray[Any]) -> Labels:
    """Copy of whole numbers of any shape as int32 if they fit, else int64."""
    low, high = numbers.min(initial=0), numbers.max(initial=0)
    small = -(2**31) <= low and high < 2**31
    return numbers.astype(np.int32 if small else np.int64)


def checked_points(source: str, points_m: AnyFloats) -> tuple[Floats, Floats]:
    """Lower and upper corner (3,) of all points (P, 3), which must be within +-1000 m."""
    if not len(points_m):
        raise SprayError(f"{source}: the mesh has no point")
    lower, upper = points_m.min(axis=0), points_m.max(axis=0)
    if not (np.all(lower >= -1e3) and np.all(upper <= 1e3)):  # false for NaN, which min keeps
        raise SprayError(f"{source}: a point of the mesh is not within +-1000 m")
    return lower.astype(np.float64), upper.astype(np.float64)


def check_labels(source: str, kind: str, labels: Labels, *, low: int, end: int) -> None:
    """Refuses `labels` of any shape outside low..end - 1; errors name `source` and `kind`."""
    if labels.size and (labels.min() < low or labels.max() >= end):
        span = f"{kind} labels {labels.min()} to {labels.max()} of the faces"
        raise SprayError(f"{source}: {span}, allowed: {low}..{end - 1}")
