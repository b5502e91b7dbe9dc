"""Conservative deposition of parcels and gas cells in bricks of finest cells."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask, kept
from cldit.errors import MediumError
from cldit.gpu.device import Device
from cldit.medium.corners import BITS, Corners, refuse
from cldit.medium.frame import BRICK, CELLS_PER_BRICK, Cube
from cldit.medium.rasterise import (
    FACE,
    BoxRasteriser,
    CloudRasteriser,
    Rasteriser,
    deposit_program,
    parts_of,
    summed,
)
from cldit.spray.extent import Box, Extent

Directory = NDArray[np.int32]  # (nb, nb, nb), [z, y, x]: slot of a brick, or -1


def _address(directory: Directory, cell: NDArray[np.signedinteger]) -> Ints:
    """Storage address (N,) of finest cells (N, 3; x, y, z)."""
    x, y, z = cell.T
    slot = directory[z // BRICK, y // BRICK, x // BRICK].astype(np.int64)
    local = (z % BRICK * BRICK + y % BRICK) * BRICK + x % BRICK
    return np.asarray(slot * CELLS_PER_BRICK + local)


def cells_of_points(frame: Cube, position_m: Floats, amount: Floats, *, content: str) -> Ints:
    """Finest cell (N, 3) of every point (N, 3).

    Raises MediumError, which names `content`, if part of `amount` (N,) is outside the cube.
    """
    place = frame.to_cells(position_m)
    outside = np.any((place < 0) | (place > frame.cells), axis=1) & (amount > 0)
    if np.any(outside):
        share = float(amount[outside].sum() / amount.sum())
        refuse(frame, content, share, position_m[outside])
    return np.clip(np.floor(place).astype(np.int64), 0, frame.cells - 1)


@dataclass(frozen=True)
class PlacedBoxes:
    """Axis-aligned boxes in units of finest cells, lower and upper (N, 3), without a device.

    shared: (N,) first of the amounts that belong to each box; None: one amount for each box.
    """

    lower: Floats
    upper: Floats
    shared: Ints | None = None

    def span(self) -> tuple[Ints, Ints]:
        """First finest cell and number of finest cells that each box touches, (N, 3) both."""
        # A face on a cell face, to within rounding, does not touch the cell beyond it.
        begin = np.floor(self.lower + FACE).astype(np.int64)
        end = np.ceil(self.upper - FACE).astype(np.int64)
        return begin, np.maximum(end - begin, 1)

    def overlaps(self) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Yields chunks of (box, finest cell (N, 3), share of the box in it); shares sum to 1."""
        begin, count = self.span()
        pairs = np.prod(count, axis=1)
        for part in parts_of(pairs):
            yield self._chunk(part.start, part.stop, begin, count, pairs)

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
        begin, count = self.span()
        for low, high in zip(begin // BRICK, (begin + count - 1) // BRICK + 1, strict=True):
            mark[low[2] : high[2], low[1] : high[1], low[0] : high[0]] = True

    def add(self, directory: Directory, amounts: list[Floats], targets: list[Floats]) -> None:
        """Adds every amount (N,), spread uniformly over its box, to its target (S,)."""
        amounts = summed(amounts, self.shared)
        for box, cell, share in self.overlaps():
            address = _address(directory, cell)
            for target, amount in zip(targets, amounts, strict=True):
                target += np.bincount(address, amount[box] * share, minlength=len(target))


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

    def add(self, directory: Directory, amounts: list[Floats], targets: list[Floats]) -> None:
        """Adds every amount (N,) to the cell of its point in its target (S,)."""
        address = _address(directory, self.cell)
        for target, amount in zip(targets, summed(amounts, self.shared), strict=True):
            target += np.bincount(address, amount, minlength=len(target))


Placed = PlacedPoints | PlacedBoxes | Rasteriser


def place_boxes(
    frame: Cube, lower_m: Floats, upper_m: Floats, *, content: str, device: Device | None = None
) -> Placed:
    """Boxes (N, 3) in the cube, or points if each box is within one cell.

    device: which spreads them over cells; None: NumPy does. Raises MediumError, which names
    `content`, if a box reaches out of the cube.
    """
    cube = frame.at(0)
    make = partial(Corners.of, cube, lower_m, upper_m, content)
    return _placed(frame, kept((lower_m, upper_m), cube, make), None, device)


def _placed(frame: Cube, corners: Corners, shared: Ints | None, device: Device | None) -> Placed:
    cells = corners.cells(frame.depth)
    if cells is not None:
        return PlacedPoints(cells, shared)
    if device is None:
        unit = np.full(1, 2.0 ** (frame.depth - BITS))
        return PlacedBoxes(corners.low.T * unit, corners.high.T * unit, shared)
    return BoxRasteriser(device, deposit_program(device), frame.cells, corners, shared)


def _boxes_of_parcels(cube: Cube, position_m: Floats, edge_m: Floats) -> tuple[Corners, Ints]:
    """Distinct boxes of parcels (N, 3), and the first parcel of each: size classes that share a box
    are consecutive."""
    differs = np.zeros(max(len(position_m) - 1, 0), bool)
    for along in position_m.T:
        differs |= along[1:] != along[:-1]
    starts = np.append(0, np.flatnonzero(differs) + 1)
    middle = np.stack([along[starts] for along in position_m.T]).T
    half = edge_m / 2
    return Corners.of(cube, middle - half, middle + half, "droplets"), starts


def place_droplets(
    frame: Cube,
    position_m: Floats,
    extent: Extent | None,
    amount: Floats,
    device: Device | None = None,
) -> Placed:
    """Parcels (N, 3) in the cube as points, boxes or clouds, by the extent of their droplets.

    device: as in `place_boxes`; clouds need one. Raises MediumError if part of `amount` (N,) is
    outside the cube, or for clouds without a device.
    """
    if isinstance(extent, Box):
        make = partial(_boxes_of_parcels, frame.at(0), position_m, extent.edge_m)
        corners, starts = kept((position_m, extent.edge_m), frame.at(0), make)
        return _placed(frame, corners, starts, device)
    cell = cells_of_points(frame, position_m, amount, content="droplets")
    if extent is None:
        return PlacedPoints(cell)
    if device is None:
        raise MediumError("clouds of droplets: no device; allowed: device=open_device()")
    place, covariance = frame.to_cells(position_m), extent.covariance_m2 / frame.cell_m**2
    return CloudRasteriser.of(device, place, covariance, frame.cells)


def touched_bricks(frame: Cube, placed: Sequence[Placed], *, limit: int) -> Directory:
    """Slots of the bricks that contain anything; raises MediumError if they have more cells than
    `limit`."""
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
    return directory
