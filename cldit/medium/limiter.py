"""Slopes between cells that make no new extremes."""

from typing import Any

import numpy as np

from cldit.arrays import Reals


def limited(middle: Reals, below: Reals, above: Reals, *, down: Any, up: Any) -> Reals:
    """Limited slope along one axis, per edge of the cell.

    middle, below, above: values of a cell and its two neighbours, of one shape. down, up: distances
    to the neighbours' middles in edges of the cell.
    """
    lower, upper = (middle - below) / down, (above - middle) / up
    central = (lower * up + upper * down) / (down + up)
    # The face is half an edge from the middle; no neighbour's value is exceeded there.
    bound = 2.0 * np.minimum(np.abs(middle - below), np.abs(above - middle))
    return np.where((lower > 0) == (upper > 0), np.clip(central, -bound, bound), 0.0)
