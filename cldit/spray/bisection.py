"""Roots of rising functions by bisection, element by element."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cldit.arrays import Floats

# A bracket of 5000 K is 2^4 times the 300 K of a root, whose numbers are 2^-52 of it apart.
TO_ROUNDING = np.finfo(float).nmant + 4


def rising_root(
    excess: Callable[[Floats], Floats], low: Floats, high: Floats, *, halvings: int = TO_ROUNDING
) -> Floats:
    """Root of a rising function between two bounds, any shape."""
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        above = excess(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(0.5 * (low + high))
