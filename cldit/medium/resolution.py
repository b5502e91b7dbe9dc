"""Resolution of a medium: cubes from coarse to the finest that fits, and the needed cell size.

Boxes on one regular grid, with edges of whole numbers of its voxels, are exact in cells that are
these voxels: the cube is then aligned with the grid, and no box is smeared over two cells. Other
boxes are resolved by cells of half their edge, of which at least one is entirely within each box.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.errors import MediumError
from cldit.gpu.device import Device
from cldit.medium.frame import BRICK, TOLERANCE, Cube
from cldit.medium.octree import Sources, placed_sources
from cldit.medium.rasterise import REACH
from cldit.spray.extent import Box, Cloud

DEEPEST = 12  # halvings of a cube
MOST_CELLS = 60_000_000
_PARTS = 4  # largest ratio of the smallest box to a voxel of the grid of all boxes
_FEW = 0.01  # share of the extinction of all boxes that may be resolved less
# Cells along a scattering medium. The error of one cell of depth 0.4 is 0.5 K, of 8^3 cells 0.06 K.
ACROSS = 8
# Memory of an empty swept cell (8 bytes, measured) and of a brick of the cube (60, by its arrays),
# over that of a stored cell (500).
_SWEPT, _BRICK = 1 / 64, 1 / 8


@dataclass(frozen=True)
class Candidate:
    """Cube with its finest cells.

    stored: finest cells in non-empty bricks, which need most of a trace's time and memory.
    swept: finest cells of the smallest box of bricks around them.
    """

    frame: Cube
    stored: int
    swept: int

    @property
    def memory_cells(self) -> int:
        """Number of stored cells that need as much memory as the whole tree."""
        return int(self.stored + _SWEPT * self.swept + _BRICK * self.frame.bricks**3)


def candidates(
    cube: Cube, sources: Sources, device: Device | None, *, limit: int = MOST_CELLS
) -> Iterator[Candidate]:
    """Yields cubes of the medium from one cell to the finest cells that fit, each twice as fine.

    All have one lower corner and edge: those of `cube`, or if the boxes of a medium are on a grid,
    of a cube aligned with it. No tree is built; bricks are only marked, level by level, while the
    caller continues.

    Args:
        cube: must contain the whole medium.
        sources: droplets and gas of any wavelength.
        device: as in `place_droplets`, as below.
        limit: largest `Candidate.memory_cells`.
    """
    refuse_outside(cube, sources)
    undivided = cube.at(0)
    laid = on_grid(undivided, sources)
    corner = undivided if laid is None else laid
    for depth in range(DEEPEST + 1):
        candidate = counted(corner.at(depth), sources, device)
        if candidate.memory_cells > limit:
            if depth == 0:
                raise MediumError(f"one cell is {candidate.memory_cells} cells; allowed: {limit}")
            return
        yield candidate


def refuse_outside(cube: Cube, sources: Sources) -> None:
    """Raises MediumError if a part of the medium is outside the cube."""
    points, cells = sources
    if points is not None and isinstance(points.extent, Cloud):
        points = replace(points, extent=None)  # a cloud is where its middle is
    placed_sources(cube.at(0), (points, cells), None)


def on_grid(cube: Cube, sources: Sources, *, voxel_m: float | None = None) -> Cube | None:
    """Cube whose finest cells are the voxels of the grid of all boxes of a medium.

    Its lower corner is that of the boxes, so that bricks begin there too; points or clouds beyond
    it move it by whole bricks. `voxel_m` is the edge of the voxels, if known.

    Returns the cube; None if there is no box, or if boxes have no common grid of voxels of at least
    a quarter of the smallest box.
    """
    corners = _corners(sources)
    if corners is None:
        return None
    origin, reach = corners
    edge = _common_edge(*_boxes(sources)) if voxel_m is None else voxel_m
    if edge is None:
        return None
    low, high = _scattered_about(cube, sources)
    begin = np.minimum(np.floor((low - origin) / (edge * BRICK)) * BRICK, 0.0)
    end = np.maximum(np.ceil((high - origin) / edge), np.rint((reach - origin) / edge))
    depth = (int((end - begin).max()) - 1).bit_length()
    if depth > DEEPEST:
        return None
    x, y, z = (float(corner) for corner in origin + begin * edge)
    return Cube(lower_m=(x, y, z), edge_m=edge * 2**depth, depth=depth)


def in_whole_cells(frame: Cube, sources: Sources) -> bool:
    """True if a medium of boxes is exact in the cells of a cube: none contains a part of a box."""
    if not known_in_boxes(sources):
        return False
    corners = (frame.to_cells(corner) for corner in _boxes(sources))
    return all(np.abs(corner - np.rint(corner)).max(initial=0.0) <= TOLERANCE for corner in corners)


def _common_edge(lower: Floats, upper: Floats) -> float | None:
    """Edge of the voxels that compose boxes (N, 3); None if there are no such voxels."""
    origin, reach = lower.min(axis=0), upper.max(axis=0)
    span = float((reach - origin).max())
    smallest = float((upper - lower).min())
    if not smallest > 0 or span / smallest > 2**DEEPEST:
        return None
    for parts in range(1, _PARTS + 1):
        edge = span / round(span / smallest * parts)  # by the span, to avoid the box's rounding
        steps = (lower - origin) / edge, (upper - origin) / edge
        if all(np.abs(step - np.rint(step)).max() <= TOLERANCE for step in steps):
            return edge
    return None


def _scattered_about(cube: Cube, sources: Sources) -> tuple[Floats, Floats]:
    """Corners of the box around points or clouds, clipped to the cube; +-inf if there are none."""
    points, _ = sources
    if points is None or len(points.position_m) == 0 or isinstance(points.extent, Box):
        return np.full(3, np.inf), np.full(3, -np.inf)
    filled = points.absorption_m2 + points.scattering_m2 > 0
    reach = np.zeros_like(points.position_m)
    if isinstance(points.extent, Cloud):
        reach = REACH * np.sqrt(np.diagonal(points.extent.covariance_m2, axis1=1, axis2=2))
    corner = np.asarray(cube.lower_m)
    low = (points.position_m - reach)[filled].min(axis=0, initial=np.inf)
    high = (points.position_m + reach)[filled].max(axis=0, initial=-np.inf)
    return np.maximum(low, corner), np.minimum(high, corner + cube.edge_m)


def needed_edge_m(cube: Cube, sources: Sources) -> float:
    """Edge of the coarsest cells that hold a medium of boxes.

    Cells are at most the voxels of its grid, or half of the edge of boxes without a grid. In a
    scattering medium they are halved until there are `ACROSS` along it. Boxes of less than a
    hundredth of the total extinction do not count: that of a box of optical depth t and smallest
    face A is A (1 - exp(-t)).
    """
    if not known_in_boxes(sources):
        raise MediumError("resolution: parcels in points or as clouds have no boxes")
    lower, upper = _boxes(sources)
    if len(lower) == 0:
        return cube.edge_m
    edges = upper - lower
    extinction, scattering = _coefficients(sources)
    grid = on_grid(cube, sources)
    if grid is None:
        shortest = edges.min(axis=1)
        taken = -np.expm1(-extinction * shortest) * np.prod(edges, axis=1) / edges.max(axis=1)
        edge = _least_but_few(shortest, taken) / 2
    else:
        edge = grid.cell_m
    if np.any(scattering > 0):
        across_m = float((upper.max(axis=0) - lower.min(axis=0)).max()) / ACROSS
        while edge > across_m * (1 + 1e-9):
            edge /= 2
    return float(edge)


def divided_voxels(cube: Cube, sources: Sources, *, leaf_m: float) -> Cube | None:
    """Cube whose cells are the voxels of a medium, halved or doubled to at most `leaf_m`.

    None if its boxes are on no common grid. Raises MediumError if it is outside `cube`.
    """
    grid = on_grid(cube.at(0), sources)
    if grid is None:
        return None
    refuse_outside(cube, sources)
    halvings = int(np.ceil(np.log2(grid.cell_m / leaf_m) - 1e-9))
    return grid.at(min(max(grid.depth + halvings, 0), DEEPEST))


def _least_but_few(values: Floats, weight: Floats) -> float:
    """Smallest of `values` (N,), except those of the smallest hundredth of `weight` (N,)."""
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(total, _FEW * total[-1])]])


def known_in_boxes(sources: Sources) -> bool:
    """True if the whole medium is boxes, without points or clouds."""
    points, _ = sources
    return points is None or len(points.position_m) == 0 or isinstance(points.extent, Box)


def _boxes(sources: Sources) -> tuple[Floats, Floats]:
    """Corners (N, 3) of all boxes, droplets first."""
    points, cells = sources
    none = np.zeros((0, 3))
    lower, upper = [none], [none]
    if points is not None and isinstance(points.extent, Box):
        half = points.extent.edge_m / 2
        lower, upper = [points.position_m - half], [points.position_m + half]
    lower += [source.lower_m for source in cells]
    upper += [source.upper_m for source in cells]
    return np.concatenate(lower), np.concatenate(upper)


def _corners(sources: Sources) -> tuple[Floats, Floats] | None:
    """Lower and upper corner (3,) of the box around all of `_boxes`; None if there is none."""
    points, cells = sources
    boxes: list[tuple[Floats, Floats, Floats | float]] = [
        (source.lower_m, source.upper_m, 0.0) for source in cells
    ]
    if points is not None and isinstance(points.extent, Box):
        boxes.append((points.position_m, points.position_m, points.extent.edge_m / 2))
    boxes = [box for box in boxes if len(box[0])]
    if not boxes:
        return None
    # One axis at a time, since numpy is ten times slower with rows of three.
    lows = [np.array([x.min() for x in lower.T]) - half for lower, _, half in boxes]
    highs = [np.array([x.max() for x in upper.T]) + half for _, upper, half in boxes]
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _coefficients(sources: Sources) -> tuple[Floats, Floats]:
    """Extinction and scattering (N,) of the boxes of `_boxes`, per metre."""
    points, cells = sources
    extinction: list[Floats] = [np.zeros(0)]
    scattering: list[Floats] = [np.zeros(0)]
    if points is not None and isinstance(points.extent, Box):
        volume = float(np.prod(points.extent.edge_m))
        _, place = np.unique(points.position_m, axis=0, return_inverse=True)
        for section, into in (
            (points.absorption_m2 + points.scattering_m2, extinction),
            (points.scattering_m2, scattering),
        ):
            into.append(np.asarray(np.bincount(place, section / volume)[place], float))
    for source in cells:
        droplets = source.droplet_absorption + source.droplet_scattering
        extinction.append(source.vapour_absorption + droplets)
        scattering.append(source.droplet_scattering)
    return np.concatenate(extinction), np.concatenate(scattering)


def counted(frame: Cube, sources: Sources, device: Device | None) -> Candidate:
    """The cube with the cells that a medium fills in it."""
    mark = np.zeros((frame.bricks,) * 3, bool)
    for placed in chain(*placed_sources(frame, sources, device)):
        placed.mark(mark)
    cells = min(BRICK, frame.cells)
    swept = 1
    for axes in ((0, 1), (0, 2), (1, 2)):
        along = np.flatnonzero(mark.any(axis=axes))
        swept *= int(along[-1] - along[0] + 1) * cells if len(along) else 0
    return Candidate(frame, int(mark.sum()) * BRICK**3, swept)


def within(cube: Cube, sources: Sources) -> tuple[Sources, float]:
    """The part of a medium inside a cube, and the share that lies outside.

    The share is that of the gas's absorption over its volume, or of the droplets' cross sections,
    whichever is larger.
    """
    points, cells = sources
    low = np.asarray(cube.lower_m)
    high = low + cube.edge_m
    lost = [0.0]
    if points is not None:
        inside = np.all((points.position_m >= low) & (points.position_m <= high), axis=1)
        section = points.absorption_m2 + points.scattering_m2
        lost.append(_outside(section, inside.astype(float)))
        points = _subset(points, inside) if inside.any() else None
    kept = []
    for source in cells:
        lower, upper = np.maximum(source.lower_m, low), np.minimum(source.upper_m, high)
        volume = np.prod(source.upper_m - source.lower_m, axis=1)
        part = np.prod(np.maximum(upper - lower, 0.0), axis=1) / volume
        optical = source.vapour_absorption + source.droplet_absorption + source.droplet_scattering
        lost.append(_outside(optical * volume, part))
        kept.append(_subset(replace(source, lower_m=lower, upper_m=upper), part > 0.0))
    return (points, kept), max(lost)


def _outside(amount: Floats, inside: Floats) -> float:
    total = float(amount.sum())
    return float(np.sum(amount * (1.0 - inside))) / total if total > 0.0 else 0.0


def _subset(source: Any, chosen: Mask) -> Any:
    """Some parcels or boxes of a source."""

    def subset(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(part[chosen] for part in value)
        return value[chosen] if isinstance(value, np.ndarray) else value.of(chosen)

    return replace(source, **{k: subset(v) for k, v in vars(source).items() if v is not None})
