"""Slopes between cells that make no new extremes."""

from typing import Any

import numpy as np

from cldit.arrays import Reals


def limited(middle: Reals, below: Reals, above: Reals, *, down: Any, up: Any) -> Reals:
    """Limited slope along one axis, per edge of the cell.

    middle, below, above: values of a cell and its two neighbours, of one shape. down, up: distances
    to the neighbours' middles in edges of the cell.
    """
    first, second = (middle - below) / down, (above - middle) / up
    central = (first * up + second * down) / (down + up)
    # The face is half an edge from the middle; no neighbour's value is exceeded there.
    most = 2.0 * np.minimum(np.abs(middle - below), np.abs(above - middle))
    return np.where((first > 0) == (second > 0), np.clip(central, -most, most), 0.0)
