"""The order in which sweeps go through a box: by tiles of rows and layers, along diagonals.

Light that goes to higher rows and later layers comes from lower and earlier ones alone. So along
all directions that do so (a quadrant) the tiles of a diagonal do not need each other, and a tile's
cells and rays stay at hand while it is crossed along each direction (Koch, Baker and Alcouffe,
Trans. Am. Nucl. Soc. 65, 1992, 198). The quadrants begin at four corners, and go at the same time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLUMNS = 8  # of the table of tiles


def _cuts(count: int, edge: int) -> NDArray[np.int32]:
    """Where tiles begin, and the end: an even number of tiles, of which some may be empty."""
    return np.linspace(0, count, 2 * -(-count // (2 * edge)) + 1).astype(np.int32)


def kba_tiles(
    rows: int, layers: int, quadrants: NDArray[np.int64], edge: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Tiles (M, COLUMNS) in the order of launches (L, 2), the first of each and its end.

    quadrants (4, 2): the first of their directions and the end; of those to later layers first,
    and in either pair of those to higher rows first. edge: rows and layers of a tile, at most.
    Columns: the row that is first, and how many; the layer that is first, counted as rays meet
    them, and how many; first direction and end; sense (1: rays meet the last layer first); 1 or -1,
    from row to row.

    As there is an even number of tiles either way, quadrants meet in no tile of a launch, but those
    of opposite corners all along the middle diagonal, which is two launches.
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
    # Neighbours, which are much the same work, to either half of a launch: devices of few compute
    # units take it in halves.
    order = np.argsort(which, kind="stable")
    begins = np.flatnonzero(np.diff(which[order], prepend=-1))
    place = np.arange(len(order)) - np.repeat(begins, np.diff(begins, append=len(order)))
    order = order[np.lexsort((place % 2, which[order]))]
    return table[order], np.column_stack([begins, [*begins[1:], len(order)]]).astype(np.int32)
