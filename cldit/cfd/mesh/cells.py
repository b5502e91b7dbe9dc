"""Meshes as the importer needs them: a box for each cell, computed some cells at a time."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.cfd.mesh import geometry
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent

AnyFloats = geometry.AnyFloats
Labels = geometry.Labels
Polyhedra = geometry.Polyhedra
Measures = geometry.Measures
# what `geometry.measure` finds wrong with a cell, from 1
_FAULTS = (
    "cell {} has fewer than four faces",
    "the faces of cell {} do not enclose it, or do not all point outwards",
    "cell {} of the mesh has no volume",
)
ORIGIN, TURN = np.zeros(3), np.eye(3)  # the case's own coordinates
AT_ONCE = 50_000  # cells; some 600 bytes a cell are in work


@dataclass(frozen=True)
class Boxes:
    """Corners lower_m and upper_m (N, 3) of boxes, and their volume_m3 (N,)."""

    lower_m: Floats
    upper_m: Floats
    volume_m3: Floats

    def take(self, chosen: Labels) -> "Boxes":
        """Selects the boxes `chosen` (N,)."""
        return Boxes(self.lower_m[chosen], self.upper_m[chosen], self.volume_m3[chosen])


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
    def polyhedra(self, cells: Labels) -> Iterator[tuple[Labels, Polyhedra]]:
        """Faces of `cells` (N,), in parts: indices into `cells`, and the polyhedra of these."""

    def measure(
        self, cells: Labels | None = None, origin_m: Floats = ORIGIN, rotation: Floats = TURN
    ) -> Measures:
        """Volume, centroid, bounds of `cells` (N,) (None: all), of rotation @ (point - origin)."""
        wanted = np.arange(self.cells) if cells is None else cells
        found = Measures(np.empty(len(wanted)), *(np.empty((len(wanted), 3)) for _ in range(3)))
        for place, part in self.polyhedra(wanted):
            for chosen, fault, own in geometry.measure(part, origin_m, rotation):
                here = place[chosen]
                if fault.any():
                    bad = int(np.flatnonzero(fault)[0])
                    text = _FAULTS[fault[bad] - 1].format(wanted[here[bad]])
                    raise SprayError(f"{self.source}: {text}")
                for name, values in vars(found).items():
                    values[here] = getattr(own, name)
        return found

    def boxes(
        self, origin_m: Floats = ORIGIN, rotation: Floats = TURN, watch: Watch = silent
    ) -> Iterator[tuple[slice, Boxes]]:
        """Boxes of all cells, some cells at a time: their range, and their boxes.

        A box has the volume and centroid of its cell and the proportions of the cell's bounding
        box; for a cell that is a box along the axes it is that box. Origin and rotation are as for
        `measure`.
        """
        for chosen in slices(self.cells):
            watch("measuring cells", chosen.start, self.cells)
            cell = self.measure(np.arange(chosen.start, chosen.stop), origin_m, rotation)
            half = cell.upper_m - cell.lower_m
            half *= (np.cbrt(cell.volume_m3 / (half[:, 0] * half[:, 1] * half[:, 2])) / 2)[:, None]
            yield chosen, Boxes(cell.centroid_m - half, cell.centroid_m + half, cell.volume_m3)


class PointMesh(CellMesh):
    """Mesh whose points (P, 3) are in memory."""

    points_m: AnyFloats

    @cached_property
    def extent_m(self) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the bounding box of all points."""
        return checked_points(self.source, self.points_m)

    def points(self) -> Iterator[AnyFloats]:
        """All points of the mesh, (P, 3) of some at a time."""
        for some in slices(len(self.points_m)):
            yield self.points_m[some]


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


def check_labels(source: str, what: str, labels: Labels, *, low: int, end: int) -> None:
    """Refuses `labels` of any shape outside low..end - 1; errors name `source` and `what`."""
    if labels.size and (labels.min() < low or labels.max() >= end):
        found = f"{what} labels {labels.min()} to {labels.max()} of the faces"
        raise SprayError(f"{source}: {found}, allowed: {low}..{end - 1}")
