"""Schedule of discrete ordinates sweeps: many ordinates together, tile by tile (KBA).

Stages 1 to 3 of `trace_source` sweep by it. Radiance at higher rows and later layers depends only
on lower and earlier ones, so the tiles of a diagonal are independent along all ordinates of a
quadrant. A tile's cells and rays stay in the cache while it is swept along each ordinate (Koch,
Baker and Alcouffe, Trans. Am. Nucl. Soc. 65, 1992, 198). The four quadrants start at four corners
at the same time.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates.axis_order import AxisOrder, axis_orders
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.segments import Segments

COLUMNS = 8  # of the table of tiles


@dataclass(frozen=True)
class SweepSchedule:
    """K ordinates of one order of axes, by quadrants, and their N segments, ordinate by ordinate.

    layout: the order of axes.
    launches: (L, 2) of the tiles, see `kba_tiles`.
    tables: arguments of kernels/sweep.cl: `tiles`, see `kba_tiles`; `begins_at` (K, layers + 1),
        first segment of each layer in the order of the sweep, and the end; `sides` (N,) faces
        through which rays leave cells after a segment, as bits of the sides of the next cell from
        which light comes (down and up along u, v, l); `shifts` (N, 4), and `parts` (N, 4) middle
        of a segment along x, y, z and its share of the layer, as in `Segments`; `backs` (K, 4)
        unit vectors to where light comes from; `beams` (K, 2) path in a layer over the cell's edge,
        and quadrature weight; `origins` (K, 4) slot of the first cell of a row, row of rays of
        the first row of cells, and number of the ordinate in its quadrature.
    spatial: those for SPATIAL_MOMENTS: `basis` (N, 4) along x, y, z, and the share of the layer;
        `basis_slopes` (K, 4) change of the basis along the ray.
    """

    layout: AxisOrder
    launches: NDArray[np.int32]
    tables: dict[str, NDArray[Any]]
    spatial: dict[str, Floats]

    def __len__(self) -> int:
        return len(self.tables["beams"])

    @classmethod
    def of(
        cls,
        layout: AxisOrder,
        number: Ints,
        directions: Ordinates,
        starts: Floats,
        *,
        edge: int,
    ) -> "SweepSchedule":
        """Schedule of the ordinates `number` (K,) of a quadrature in one order of axes."""
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
        begins = np.column_stack([begins, [*begins[1:, 0], len(layer)]])
        side = 2 * np.arange(3) + (runs < 0)
        sides = (segments.exits << side[segments.ordinate]).sum(axis=1)
        tiles, launches = kba_tiles(nv, nl, np.column_stack([ends[:-1], ends[1:]]), edge)
        nothing = np.zeros((count, 1))
        # Rays shift by up to nl + 1 cells towards larger u and v.
        origins = np.where(runs[:, :2] > 0, nl + 1, 1)
        back, share = directions.unit[number], segments.layer_share
        slopes = segments.basis_scale[:, inverse] * back
        return cls(
            layout=layout,
            launches=launches,
            tables={
                "tiles": tiles,
                "begins_at": begins.astype(np.int32),
                "sides": sides.astype(np.int32),
                "shifts": segments.shifts(),
                "parts": np.column_stack([segments.midpoint[:, inverse], share]),
                "backs": np.column_stack([back, nothing]),
                "beams": np.column_stack([path, directions.weight[number]]),
                "origins": np.column_stack([origins, number, nothing]).astype(np.int32),
            },
            spatial={
                "basis": np.column_stack([segments.basis[:, inverse], share]),
                "basis_slopes": np.column_stack([slopes, nothing]),
            },
        )


def sweep_schedules(
    box: SweptBox, directions: Ordinates, starts: Floats, *, batch: int, edge: int
) -> Iterator[SweepSchedule]:
    """Yields schedules of a quadrature's N ordinates, one order of axes after the other.

    Args:
        starts: (N, 2) positions of rays of each ordinate in the first layer's cells, 0 to 1.
        batch: largest number of ordinates of a schedule.
        edge: of tiles, see `kba_tiles`.
    """
    main = np.argmax(np.abs(directions.unit), axis=1)
    for axis, layout in axis_orders(box.shape).items():
        number = np.flatnonzero(main == axis)
        for start in range(0, len(number), batch):
            numbers = number[start : start + batch]
            yield SweepSchedule.of(layout, numbers, directions, starts, edge=edge)


def _cuts(count: int, edge: int) -> NDArray[np.int32]:
    """Bounds of an even number of tiles, which may be empty."""
    return np.linspace(0, count, 2 * -(-count // (2 * edge)) + 1).astype(np.int32)


def kba_tiles(
    rows: int, layers: int, quadrants: Ints, edge: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Tiles of all quadrants, in the order of kernel launches.

    With an even number of tiles in both directions, two quadrants share a tile in a launch only on
    the middle diagonal, if their corners are opposite; so that diagonal is two launches.

    Args:
        quadrants: (4, 2) first ordinate and end; towards later layers before earlier ones, and in
            either pair towards higher rows before lower ones.
        edge: largest number of rows and layers of a tile.

    Returns:
        Tiles (M, COLUMNS) and launches (L, 2), the first tile of each and the end. Columns: first
        row and number of rows; first layer, counted in the order of the sweep, and number of
        layers; first ordinate and end; sense (1: the last layer is first); 1 or -1 from row to row.
    """
    row, layer = _cuts(rows, edge), _cuts(layers, edge)
    bands, chunks = len(row) - 1, len(layer) - 1
    band, chunk = (grid.reshape(-1) for grid in np.mgrid[:bands, :chunks])
    launch, parts = [], []
    for number, (first, end) in enumerate(quadrants):
        sense, down = divmod(number, 2)
        diagonal = (bands - 1 - band if down else band) + (chunks - 1 - chunk if sense else chunk)
        low, high, begin_layer, end_layer = row[band], row[band + 1], layer[chunk], layer[chunk + 1]
        table = np.empty((len(band), COLUMNS), np.int32)
        table[:, 0] = high - 1 if down else low
        table[:, 1] = high - low
        table[:, 2] = layers - end_layer if sense else begin_layer
        table[:, 3] = end_layer - begin_layer
        table[:, 4:] = first, end, sense, -1 if down else 1
        filled = (high > low) & (end_layer > begin_layer) & (end > first)
        parts.append(table[filled])
        twice = 2 * diagonal + (sense == 1) * (2 * diagonal == bands + chunks - 2)
        launch.append(twice[filled])
    launch_number, table = np.concatenate(launch), np.concatenate(parts)
    # Neighbours have about equal work and go to different halves of a launch, because devices with
    # few compute units process it in halves.
    order = np.argsort(launch_number, kind="stable")
    begins = np.flatnonzero(np.diff(launch_number[order], prepend=-1))
    place = np.arange(len(order)) - np.repeat(begins, np.diff(begins, append=len(order)))
    order = order[np.lexsort((place % 2, launch_number[order]))]
    return table[order], np.column_stack([begins, [*begins[1:], len(order)]]).astype(np.int32)
