"""Conservative deposition of parcels and gas cells in bricks of finest cells."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask
from cldit.errors import MediumError
from cldit.gpu.device import Device
from cldit.medium.frame import BRICK, CELLS_PER_BRICK, Frame
from cldit.medium.lattice import Lattice
from cldit.medium.rasterise import BoxRasteriser, CloudRasteriser
from cldit.spray.extent import Box, Extent

_PAIRS_AT_ONCE = 4_000_000  # bounds the memory of a deposition: about 60 bytes a pair
_OUTSIDE = 1e-9  # share of a box that may be outside the cube: rounding of its corners


@dataclass(frozen=True)
class Touched:
    """Bricks that contain anything.

    directory: (nb, nb, nb) int32 in [z, y, x] order, slot of the brick or -1; slots: their number.
    """

    directory: NDArray[np.int32]
    slots: int

    def address(self, cell: NDArray[np.signedinteger]) -> Ints:
        """Storage address (N,) of finest cells (N, 3; x, y, z)."""
        x, y, z = cell.T
        slot = self.directory[z // BRICK, y // BRICK, x // BRICK].astype(np.int64)
        local = (z % BRICK * BRICK + y % BRICK) * BRICK + x % BRICK
        return np.asarray(slot * CELLS_PER_BRICK + local)


def cells_of_points(frame: Frame, position_m: Floats, amount: Floats, *, content: str) -> Ints:
    """Finest cell (N, 3) of every point (N, 3).

    Raises MediumError, which names `content`, if part of `amount` (N,) is outside the cube.
    """
    place = frame.to_cells(position_m)
    outside = np.any((place < 0) | (place > frame.cells), axis=1) & (amount > 0)
    if np.any(outside):
        share = float(amount[outside].sum() / amount.sum())
        _refuse(
            frame, content, share, position_m[outside].min(axis=0), position_m[outside].max(axis=0)
        )
    return np.clip(np.floor(place).astype(np.int64), 0, frame.cells - 1)


def _refuse(frame: Frame, content: str, share: float, low: Floats, high: Floats) -> None:
    corner = np.asarray(frame.lower_m)
    raise MediumError(
        f"{100 * share:.3g} % of the {content} is outside the domain: at "
        f"{np.round(low, 4).tolist()} to {np.round(high, 4).tolist()} m; the cube reaches from "
        f"{np.round(corner, 4).tolist()} to {np.round(corner + frame.edge_m, 4).tolist()} m; "
        "enlarge domain.edge_m or move domain.centre_m"
    )


@dataclass(frozen=True)
class PlacedBoxes:
    """Axis-aligned boxes in units of finest cells, lower and upper (N, 3).

    shared: (N,) first of the amounts that belong to each box; None: one amount for each box.
    device: which rasterises them among the `cells` along an edge of the cube; None: NumPy does.
    """

    lower: Floats
    upper: Floats
    shared: Ints | None = None
    cells: int = 0
    device: Device | None = None

    @classmethod
    def place(
        cls, frame: Frame, lower_m: Floats, upper_m: Floats, *, content: str, device: Device | None
    ) -> "PlacedBoxes":
        """Boxes (N, 3) in the cube.

        Raises MediumError, which names `content`, if a box reaches out of the cube.
        """
        lower, upper = frame.to_cells(lower_m), frame.to_cells(upper_m)
        slack = _OUTSIDE * frame.cells + _OUTSIDE * np.abs(lower).max(initial=0.0)
        if (lower < -slack).any() or (upper > frame.cells + slack).any():
            outside = np.any((lower < -slack) | (upper > frame.cells + slack), axis=1)
            _refuse(
                frame,
                f"{content} (cells)",
                float(np.mean(outside)),
                lower_m[outside].min(axis=0),
                upper_m[outside].max(axis=0),
            )
        for corner in (lower, upper):
            np.clip(corner, 0, frame.cells, out=corner)
        return cls(lower, upper, None, frame.cells, device)

    def span(self) -> tuple[Ints, Ints]:
        """First finest cell and number of finest cells that each box touches, (N, 3) both."""
        # A face on a cell face, to within rounding, does not touch the cell beyond it.
        begin = np.floor(self.lower + 1e-6).astype(np.int64)
        end = np.ceil(self.upper - 1e-6).astype(np.int64)
        return begin, np.maximum(end - begin, 1)

    def overlaps(self) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Yields chunks of (box, finest cell (N, 3), share of the box in it); shares sum to 1."""
        begin, count = self.span()
        pairs = np.prod(count, axis=1)
        ends = np.cumsum(pairs)
        start = 0
        while start < len(pairs):
            done = ends[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(ends, done + _PAIRS_AT_ONCE, "right")))
            yield self._chunk(start, stop, begin, count, pairs)
            start = stop

    def _chunk(
        self, start: int, stop: int, begin: Ints, count: Ints, pairs: Ints
    ) -> tuple[Ints, Ints, Floats]:
        box = np.repeat(np.arange(start, stop), pairs[start:stop])
        within = np.arange(len(box)) - np.repeat(
            np.cumsum(pairs[start:stop]) - pairs[start:stop], pairs[start:stop]
        )
        cell = np.empty((len(box), 3), np.int64)
        share = np.ones(len(box))
        for axis in range(3):
            within, step = np.divmod(within, count[box, axis])
            cell[:, axis] = begin[box, axis] + step
            low = np.maximum(self.lower[box, axis], cell[:, axis])
            high = np.minimum(self.upper[box, axis], cell[:, axis] + 1)
            # The neighbour receives a sliver outside the span in full.
            low = np.where(step == 0, self.lower[box, axis], low)
            high = np.where(step == count[box, axis] - 1, self.upper[box, axis], high)
            share *= (high - low) / (self.upper[box, axis] - self.lower[box, axis])
        return box, cell, share

    def mark(self, mark: Mask) -> None:
        """Sets the bricks (nb, nb, nb) that the boxes touch."""
        if self.device is not None:
            self._rasteriser.mark(mark)
            return
        begin, count = self.span()
        for low, high in zip(begin // BRICK, (begin + count - 1) // BRICK + 1, strict=True):
            mark[low[2] : high[2], low[1] : high[1], low[0] : high[0]] = True

    def add(self, touched: Touched, amounts: list[Floats], targets: list[Floats]) -> None:
        """Adds every amount (N,), spread uniformly over its box, to its target (S,)."""
        amounts = _summed(amounts, self.shared)
        if self.device is not None:
            self._rasteriser.add(touched.directory, amounts, targets)
            return
        for box, cell, share in self.overlaps():
            address = touched.address(cell)
            for target, amount in zip(targets, amounts, strict=True):
                target += np.bincount(address, amount[box] * share, minlength=len(target))

    @cached_property
    def _rasteriser(self) -> BoxRasteriser:
        assert self.device is not None
        return BoxRasteriser.of(self.device, self.lower, self.upper, self.span(), self.cells)


def _summed(amounts: list[Floats], shared: Ints | None) -> list[Floats]:
    return amounts if shared is None else [np.add.reduceat(amount, shared) for amount in amounts]


@dataclass(frozen=True)
class PlacedPoints:
    """Points, or objects within one finest cell: the cell (N, 3) of each.

    shared: as in `PlacedBoxes`.
    """

    cell: NDArray[np.signedinteger]
    shared: Ints | None = None

    def mark(self, mark: Mask) -> None:
        """Sets the bricks (nb, nb, nb) that contain a point."""
        brick = self.cell // BRICK
        mark[brick[:, 2], brick[:, 1], brick[:, 0]] = True

    def add(self, touched: Touched, amounts: list[Floats], targets: list[Floats]) -> None:
        """Adds every amount (N,) to the cell of its point in its target (S,)."""
        address = touched.address(self.cell)
        for target, amount in zip(targets, _summed(amounts, self.shared), strict=True):
            target += np.bincount(address, amount, minlength=len(target))


@dataclass(frozen=True)
class PlacedClouds:
    """Clouds in the cube, in units of finest cells: place (N, 3) and covariance (N, 3, 3).

    device: which rasterises them.
    """

    place: Floats
    covariance: Floats
    cells: int
    device: Device | None

    @cached_property
    def _rasteriser(self) -> CloudRasteriser:
        if self.device is None:
            raise MediumError("clouds of droplets: no device; allowed: device=open_device()")
        return CloudRasteriser.of(self.device, self.place, self.covariance, self.cells)

    def mark(self, mark: Mask) -> None:
        """Sets the bricks (nb, nb, nb) that a cloud reaches."""
        self._rasteriser.mark(mark)

    def add(self, touched: Touched, amounts: list[Floats], targets: list[Floats]) -> None:
        """Adds every amount (N,), spread over its cloud, to its target (S,)."""
        self._rasteriser.add(touched.directory, amounts, targets)


Placed = PlacedPoints | PlacedBoxes | PlacedClouds


def place_boxes(
    frame: Frame,
    lower_m: Floats,
    upper_m: Floats,
    *,
    content: str,
    shared: Ints | None = None,
    device: Device | None = None,
) -> PlacedBoxes | PlacedPoints:
    """Boxes (N, 3) in the cube, or points if each box of a lattice is within one cell.

    Raises as `PlacedBoxes.place`; `shared` as in `PlacedBoxes`.
    """
    boxes = PlacedBoxes.place(frame, lower_m, upper_m, content=content, device=device)
    lattice = Lattice.of(boxes.lower, boxes.upper)
    cells = None if lattice is None else lattice.cells()
    return replace(boxes, shared=shared) if cells is None else PlacedPoints(cells, shared)


def place_droplets(
    frame: Frame,
    position_m: Floats,
    extent: Extent | None,
    amount: Floats,
    device: Device | None = None,
) -> Placed:
    """Parcels (N, 3) in the cube as points, boxes or clouds, by the extent of their droplets.

    device: which rasterises clouds and boxes; None: there are no clouds, or only their place is of
        interest.

    Raises MediumError if part of `amount` (N,) is outside the cube.
    """
    if isinstance(extent, Box):
        # Size classes that share a box are consecutive.
        differs = np.zeros(max(len(position_m) - 1, 0), bool)
        for along in position_m.T:
            differs |= along[1:] != along[:-1]
        starts = np.append(0, np.flatnonzero(differs) + 1)
        middle = np.stack([along[starts] for along in position_m.T]).T
        half = extent.edge_m / 2
        return place_boxes(
            frame, middle - half, middle + half, content="droplets", shared=starts, device=device
        )
    cell = cells_of_points(frame, position_m, amount, content="droplets")
    if extent is None:
        return PlacedPoints(cell)
    return PlacedClouds(
        frame.to_cells(position_m), extent.covariance_m2 / frame.cell_m**2, frame.cells, device
    )


def touched_bricks(frame: Frame, placed: Sequence[Placed], *, limit: int) -> Touched:
    """Bricks that contain anything; raises MediumError if they have more cells than `limit`."""
    mark = np.zeros((frame.bricks,) * 3, bool)
    for source in placed:
        source.mark(mark)
    slots = int(mark.sum())
    if slots * CELLS_PER_BRICK > limit:
        raise MediumError(
            f"the spray fills {slots * CELLS_PER_BRICK:.3g} cells of {frame.cell_m * 1e3:.3g} mm; "
            f"allowed: {limit:.3g}; set domain.leaf_edge_m above {2 * frame.cell_m:.3g}, or omit "
            "it with domain.rule: need"
        )
    directory = np.full(mark.shape, -1, np.int32)
    directory[mark] = np.arange(slots, dtype=np.int32)
    return Touched(directory=directory, slots=slots)
