"""Sets of directions as sweeps go along them: tile by tile, many directions together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import Box
from cldit.transport.discrete_ordinates.axis_order import AxisOrder, axis_orders
from cldit.transport.discrete_ordinates.kba_tiles import kba_tiles
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.segments import Segments

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SweepSchedule:
    """K directions whose layers lie alike, by quadrants; N steps, of one direction after the other.

    number (K,): of each direction in its set. tiles, launches: the order in which the box is gone
    through (tiles.py). begins (K, layers + 1): where the steps of each layer begin, as rays meet
    them, and the end. shifts (N, 4): as in `Segments`. part (N,): share of the layer that is
    crossed;
    middle (N, 3): of the step in the cells, 0 to 1. lever (N, 3), gain (K, 3): as in `Segments`,
    along
    x, y, z.
    faces (N,): through which rays leave cells after the step, bits of the sides on which light
    comes from there: down and up along u, v, l.
    back (K, 3): where light comes from. stretch (K,): path in a layer / cell edge. weight (K,).
    rightwards, upwards (K,): rays move to larger u, to larger v.
    """

    layout: AxisOrder
    number: NDArray[np.int32]
    tiles: NDArray[np.int32]
    launches: NDArray[np.int32]
    begins: NDArray[np.int32]
    shifts: NDArray[np.int32]
    part: Floats
    middle: Floats
    basis: Floats
    gain: Floats
    faces: NDArray[np.int32]
    back: Floats
    stretch: Floats
    weight: Floats
    rightwards: NDArray[np.bool_]
    upwards: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.number)

    @classmethod
    def of(
        cls,
        layout: AxisOrder,
        number: NDArray[np.int64],
        directions: Ordinates,
        starts: Floats,
        *,
        edge: int,
    ) -> SweepSchedule:
        """edge: of tiles, see `kba_tiles`."""
        # Light runs away from where it comes from.
        runs = -directions.unit[number][:, layout.axes]
        quadrant = 2 * (runs[:, 2] < 0) + (runs[:, 1] < 0)
        order = np.argsort(quadrant, kind="stable")
        number, runs = number[order], runs[order]
        ends = np.searchsorted(quadrant[order], np.arange(5))
        _, nv, nl = layout.size
        stretch = 1 / np.abs(runs[:, 2])
        inverse = np.argsort(layout.axes)
        count = len(runs)
        segments = Segments.of(
            runs[:, :2] * stretch[:, None], starts[number], layers=nl, backwards=runs[:, 2] < 0
        )
        layer = segments.way * nl + segments.met  # of all ways
        begins = np.searchsorted(layer, np.arange(count * nl)).reshape(count, -1)
        side = 2 * np.arange(3) + (runs < 0)
        table, launches = kba_tiles(nv, nl, np.column_stack([ends[:-1], ends[1:]]), edge)
        return cls(
            layout=layout,
            number=number.astype(np.int32),
            tiles=table,
            launches=launches,
            begins=np.column_stack([begins, [*begins[1:, 0], len(layer)]]).astype(np.int32),
            shifts=segments.shifts(),
            part=segments.part,
            middle=segments.within[:, inverse],
            basis=segments.basis[:, inverse],
            gain=segments.gain[:, inverse],
            faces=(segments.leaves << side[segments.way]).sum(axis=1).astype(np.int32),
            back=directions.unit[number],
            stretch=stretch,
            weight=directions.weight[number],
            rightwards=runs[:, 0] > 0,
            upwards=runs[:, 1] > 0,
        )


def sweep_schedules(
    box: Box, directions: Ordinates, starts: Floats, *, together: int, edge: int
) -> Iterator[SweepSchedule]:
    """All directions, at most so many together.

    starts: (len(directions), 2) in 0..1, where rays cross the cells of the first layer.
    """
    main = np.argmax(np.abs(directions.unit), axis=1)
    for axis, layout in axis_orders(box.shape).items():
        number = np.flatnonzero(main == axis)
        for first in range(0, len(number), together):
            some = number[first : first + together]
            yield SweepSchedule.of(layout, some, directions, starts, edge=edge)
