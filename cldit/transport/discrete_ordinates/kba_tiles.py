"""KBA tiles: the order of discrete ordinates sweeps through tiles of rows and layers.

Radiance that goes to higher rows and later layers depends on lower and earlier ones alone. So along
all ordinates of a quadrant the tiles of a diagonal are independent. A tile's cells and rays stay in
the cache while it is swept along each ordinate (Koch, Baker and Alcouffe, Trans. Am. Nucl. Soc. 65,
1992, 198). The four quadrants begin at four corners at the same time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLUMNS = 8  # of the table of tiles


def _cuts(count: int, edge: int) -> NDArray[np.int32]:
    """Bounds of an even number of tiles, some of which may be empty."""
    return np.linspace(0, count, 2 * -(-count // (2 * edge)) + 1).astype(np.int32)


def kba_tiles(
    rows: int, layers: int, quadrants: NDArray[np.int64], edge: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The tiles of all quadrants, in the order of kernel launches.

    With an even number of tiles either way no two quadrants share a tile in a launch, but for those
    of opposite corners on the middle diagonal, which is therefore two launches.

    Args:
        quadrants: (4, 2) first ordinate and end; towards later layers before earlier ones, and in
            either pair towards higher rows before lower ones.
        edge: rows and layers of a tile, at most.

    Returns:
        Tiles (M, COLUMNS) and launches (L, 2), the first tile of each and the end. Columns: first
        row and number of rows; first layer, counted in the order of the sweep, and number of
        layers; first ordinate and end; sense (1: the last layer is first); 1 or -1 from row to row.
    """
    row, layer = _cuts(rows, edge), _cuts(layers, edge)
    bands, chunks = len(row) - 1, len(layer) - 1
    band, chunk = (each.reshape(-1) for each in np.mgrid[:bands, :chunks])
    launch, parts = [], []
    for number, (first, end) in enumerate(quadrants):
        sense, down = divmod(number, 2)
        diagonal = (bands - 1 - band if down else band) + (chunks - 1 - chunk if sense else chunk)
        low, high, near, far = row[band], row[band + 1], layer[chunk], layer[chunk + 1]
        table = np.empty((len(band), COLUMNS), np.int32)
        table[:, 0] = high - 1 if down else low
        table[:, 1] = high - low
        table[:, 2] = layers - far if sense else near
        table[:, 3] = far - near
        table[:, 4:] = first, end, sense, -1 if down else 1
        some = (high > low) & (far > near) & (end > first)
        parts.append(table[some])
        twice = 2 * diagonal + (sense == 1) * (2 * diagonal == bands + chunks - 2)
        launch.append(twice[some])
    which, table = np.concatenate(launch), np.concatenate(parts)
    # Neighbours are about equal work and go to different halves of a launch: devices of few compute
    # units take it in halves.
    order = np.argsort(which, kind="stable")
    begins = np.flatnonzero(np.diff(which[order], prepend=-1))
    place = np.arange(len(order)) - np.repeat(begins, np.diff(begins, append=len(order)))
    order = order[np.lexsort((place % 2, which[order]))]
    return table[order], np.column_stack([begins, [*begins[1:], len(order)]]).astype(np.int32)
