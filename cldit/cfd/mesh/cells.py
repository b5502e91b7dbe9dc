"""Meshes as the importer needs them: volume, centroid and bounds of cells."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.cfd.mesh import geometry
from cldit.errors import SprayError

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
            for chosen, fault, values in geometry.measure(part):
                indices = place[chosen]
                if fault.any():
                    bad = int(np.flatnonzero(fault)[0])
                    message = _FAULTS[fault[bad] - 1].format(cells[indices[bad]])
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
