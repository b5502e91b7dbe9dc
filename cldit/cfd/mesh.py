"""Meshes as the importer needs them: a box for each cell, worked out some cells at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import SprayError
from cldit.progress import Watch, silent
from cldit.spray.result import Floats

Labels = NDArray[np.signedinteger]
AnyFloats = NDArray[np.floating]

# what `cell_geometry.measure` finds wrong with a cell, from 1
_FAULTS = (
    "cell {} has fewer than four faces",
    "the faces of cell {} do not enclose it, or do not all point outwards",
    "cell {} of the mesh has no volume",
)
AT_ONCE = 50_000  # cells; some 600 bytes a cell are in work


@dataclass(frozen=True)
class Polyhedra:
    """Cells by their faces, as `cell_geometry.measure` takes them.

    points_m (P, 3); face f has the corners `corners[start[f]:start[f + 1]]`; cell c has the sides
    `sides[first[c]:first[c + 1]]`, f where the normal of face f points out of the cell and -1 - f
    where it points into it; `members` (N,) are the cells that are meant.
    """

    points_m: AnyFloats
    corners: Labels
    start: Labels
    first: Labels
    sides: Labels
    members: Labels


@dataclass(frozen=True)
class Measures:
    """Of each cell: volume_m3 (N,), centroid_m and the bounding box lower_m, upper_m (N, 3)."""

    volume_m3: Floats
    centroid_m: Floats
    lower_m: Floats
    upper_m: Floats


@dataclass(frozen=True)
class Boxes:
    """lower_m and upper_m (N, 3) of boxes, and their volume_m3 (N,)."""

    lower_m: Floats
    upper_m: Floats
    volume_m3: Floats

    def take(self, chosen: Labels) -> Boxes:
        """Some of them (N,)."""
        return Boxes(self.lower_m[chosen], self.upper_m[chosen], self.volume_m3[chosen])


class CellMesh(ABC):
    """`cells` cells; `source` is the file or folder to name in errors."""

    source: str
    cells: int

    @property
    @abstractmethod
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the box that holds all points."""

    @abstractmethod
    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """The faces of `cells` (N,), in parts: places in `cells`, and the polyhedra of these."""

    def measure(
        self,
        cells: Labels | None = None,
        *,
        origin_m: Floats | None = None,
        rotation: Floats | None = None,
    ) -> Measures:
        """Volume, centroid and bounds.

        Args:
            cells: (N,) those that are measured; None is all.
            origin_m: (3,) the figures are seen from there.
            rotation: (3, 3) and turned by this matrix.

        Raises:
            SprayError: a cell has no volume, or its faces do not enclose it.
        """
        # brings a compiler, which who only lists a case does not need
        from cldit.cfd import cell_geometry

        wanted = np.arange(self.cells) if cells is None else cells
        count = len(wanted)
        found = Measures(np.empty(count), *(np.empty((count, 3)) for _ in range(3)))
        origin = np.zeros(3) if origin_m is None else np.asarray(origin_m, np.float64)
        turn = np.eye(3) if rotation is None else np.ascontiguousarray(rotation)
        for place, part in self.polyhedra(wanted):
            whole = len(place) == count
            own = found if whole else Measures(*(values[place] for values in vars(found).values()))
            fault = np.empty(len(place), np.int8)
            cell_geometry.measure(
                part.points_m,
                part.corners,
                part.start,
                part.first,
                part.sides,
                part.members,
                origin,
                turn,
                own.volume_m3,
                own.centroid_m,
                own.lower_m,
                own.upper_m,
                fault,
            )
            self._refuse(wanted[place], fault)
            if not whole:
                for all_, some in zip(vars(found).values(), vars(own).values(), strict=True):
                    all_[place] = some
        return found

    def _refuse(self, cells: Labels, fault: NDArray[np.int8]) -> None:
        for number, text in enumerate(_FAULTS, start=1):
            bad = np.flatnonzero(fault == number)
            if len(bad):
                raise SprayError(f"{self.source}: " + text.format(cells[bad[0]]))

    def boxes(
        self,
        *,
        origin_m: Floats | None = None,
        rotation: Floats | None = None,
        watch: Watch = silent,
    ) -> Iterator[tuple[slice, Boxes]]:
        """A box for each cell, for some cells at a time: which cells, and their boxes.

        A box has the volume and centroid of its cell and the proportions of the cell's bounding
        box; for a cell that is a box along the axes it is that box.

        Args:
            origin_m, rotation: as for `measure`.
            watch: told how far the work is.

        Raises:
            SprayError: as for `measure`.
        """
        for begin in range(0, self.cells, AT_ONCE):
            watch("measuring cells", begin, self.cells)
            chosen = slice(begin, min(begin + AT_ONCE, self.cells))
            cell = self.measure(
                np.arange(chosen.start, chosen.stop), origin_m=origin_m, rotation=rotation
            )
            half = cell.upper_m - cell.lower_m
            half *= (np.cbrt(cell.volume_m3 / (half[:, 0] * half[:, 1] * half[:, 2])) / 2)[:, None]
            yield chosen, Boxes(cell.centroid_m - half, cell.centroid_m + half, cell.volume_m3)


def narrowed(numbers: NDArray[Any]) -> Labels:
    """Whole numbers as integers of their own, four bytes each where that is enough."""
    low, high = numbers.min(initial=0), numbers.max(initial=0)
    small = -(2**31) <= low and high < 2**31
    return numbers.astype(np.int32 if small else np.int64)


def checked_points(source: str, points_m: AnyFloats) -> tuple[Floats, Floats]:
    """Lower and upper corner of all points (P, 3).

    Raises:
        SprayError: one is not finite, or farther than 1000 m; the message begins with `source`.
    """
    if not len(points_m):
        raise SprayError(f"{source}: the mesh has no point")
    lower, upper = points_m.min(axis=0), points_m.max(axis=0)
    if not (np.all(lower >= -1e3) and np.all(upper <= 1e3)):  # false for NaN, which min keeps
        raise SprayError(f"{source}: a point of the mesh is not within +-1000 m")
    return lower.astype(np.float64), upper.astype(np.float64)


def check_labels(source: str, what: str, labels: Labels, *, low: int, end: int) -> None:
    """Raises SprayError where one of `labels` is outside low..end - 1."""
    if labels.size and (labels.min() < low or labels.max() >= end):
        raise SprayError(
            f"{source}: {what} labels {labels.min()} to {labels.max()} of the faces, "
            f"allowed is {low}..{end - 1}"
        )


@dataclass(frozen=True)
class Mesh(CellMesh):
    """Cells by their faces.

    points_m (P, 3); face f has the corners `corners[start[f]:start[f + 1]]`, ordered so that its
    normal points out of the cell `owner[f]` and into `neighbour[f]`, which is -1 on the boundary;
    `cells` is the number of cells, `source` the file or folder to name in errors.
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
        for what, labels, low, end in (
            ("point", self.corners, 0, len(self.points_m)),
            ("owner", self.owner, 0, self.cells),
            ("neighbour", self.neighbour, -1, self.cells),
        ):
            check_labels(self.source, what, labels, low=low, end=end)
        _ = self.extent_m

    @cached_property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the box that holds all points."""
        return checked_points(self.source, self.points_m)

    @cached_property
    def _sides(self) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Where each cell begins, and the sides of all cells, as `Polyhedra` has them."""
        from cldit.cfd import cell_geometry

        first = np.zeros(self.cells + 1, np.int64)
        sides = np.empty(len(self.owner) + np.count_nonzero(self.neighbour >= 0), np.int32)
        cell_geometry.sides_of_cells(self.owner, self.neighbour, first, sides)
        return first, sides

    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """The faces of `cells` (N,), all in one part."""
        first, sides = self._sides
        yield (
            np.arange(len(cells)),
            Polyhedra(self.points_m, self.corners, self.start, first, sides, cells),
        )


@dataclass(frozen=True)
class JoinedMesh(CellMesh):
    """One mesh of several, cells in order; faces between them stay double, which harms no sum."""

    parts: Sequence[CellMesh]

    @property
    def source(self) -> str:  # type: ignore[override]
        """That of the first."""
        return self.parts[0].source

    @cached_property
    def _ends(self) -> Labels:
        return np.cumsum([part.cells for part in self.parts])

    @property
    def cells(self) -> int:  # type: ignore[override]
        """Those of all."""
        return int(self._ends[-1])

    @property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the box that holds all points."""
        lower, upper = zip(*(part.extent_m for part in self.parts), strict=True)
        return np.min(lower, axis=0), np.max(upper, axis=0)

    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """The faces of `cells` (N,), those of one mesh after the other."""
        mesh = np.searchsorted(self._ends, cells, side="right")
        for number in np.unique(mesh).tolist():
            here = np.flatnonzero(mesh == number)
            part = self.parts[number]
            for place, found in part.polyhedra(cells[here] - (self._ends[number] - part.cells)):
                yield here[place], found


def join(meshes: Sequence[CellMesh]) -> CellMesh:
    """One mesh of several, cells in order."""
    return meshes[0] if len(meshes) == 1 else JoinedMesh(meshes)
