"""Sweep schedule of discrete ordinates: many ordinates together, tile by tile (KBA).

Stages 1 to 3 of `trace_source` sweep by it.
"""

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
    """K ordinates of one order of axes, by quadrants, and their N segments, ordinate by ordinate.

    layout: the order of axes.
    number: (K,) of each ordinate in its quadrature.
    tiles, launches: of the box, see kba_tiles.py.
    begins: (K, layers + 1) first segment of each layer in the order of the sweep, and the end.
    shifts: (N, 4) as in `Segments`.
    layer_share: (N,) as in `Segments`.
    midpoint, basis: (N, 3) as in `Segments`, along x, y, z.
    basis_scale: (K, 3) as in `Segments`, along x, y, z.
    exit_faces: (N,) faces through which rays leave cells after the segment. They are bits of the
        sides of the next cell from which light comes: down and up along u, v, l.
    back: (K, 3) unit vectors to where light comes from.
    path_per_layer: (K,) path in a layer over the cell's edge.
    weight: (K,) quadrature weights.
    rightwards, upwards: (K,) whether rays move to larger u, to larger v.
    """

    layout: AxisOrder
    number: NDArray[np.int32]
    tiles: NDArray[np.int32]
    launches: NDArray[np.int32]
    begins: NDArray[np.int32]
    shifts: NDArray[np.int32]
    layer_share: Floats
    midpoint: Floats
    basis: Floats
    basis_scale: Floats
    exit_faces: NDArray[np.int32]
    back: Floats
    path_per_layer: Floats
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
        """Schedule of ordinates `number` of a quadrature; for the rest see `sweep_schedules`."""
        # Light travels away from where it comes from.
        runs = -directions.unit[number][:, layout.axes]
        quadrant = 2 * (runs[:, 2] < 0) + (runs[:, 1] < 0)
        order = np.argsort(quadrant, kind="stable")
        number, runs = number[order], runs[order]
        ends = np.searchsorted(quadrant[order], np.arange(5))
        _, nv, nl = layout.size
        path = 1 / np.abs(runs[:, 2])
        inverse = np.argsort(layout.axes)
        count = len(runs)
        segments = Segments.of(
            runs[:, :2] * path[:, None], starts[number], layers=nl, backwards=runs[:, 2] < 0
        )
        layer = segments.ordinate * nl + segments.layer  # of all ordinates
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
            layer_share=segments.layer_share,
            midpoint=segments.midpoint[:, inverse],
            basis=segments.basis[:, inverse],
            basis_scale=segments.basis_scale[:, inverse],
            exit_faces=(segments.exits << side[segments.ordinate]).sum(axis=1).astype(np.int32),
            back=directions.unit[number],
            path_per_layer=path,
            weight=directions.weight[number],
            rightwards=runs[:, 0] > 0,
            upwards=runs[:, 1] > 0,
        )


def sweep_schedules(
    box: Box, directions: Ordinates, starts: Floats, *, together: int, edge: int
) -> Iterator[SweepSchedule]:
    """Schedules of all ordinates of a quadrature.

    Args:
        starts: (N, 2) where rays of each ordinate cross the cells of the first layer, 0 to 1.
        together: ordinates of a schedule, at most.
        edge: of tiles, see `kba_tiles`.
    """
    main = np.argmax(np.abs(directions.unit), axis=1)
    for axis, layout in axis_orders(box.shape).items():
        number = np.flatnonzero(main == axis)
        for first in range(0, len(number), together):
            some = number[first : first + together]
            yield SweepSchedule.of(layout, some, directions, starts, edge=edge)
