"""How many spectral nodes are enough: the smallest number from which the error stays small.

The error does not fall evenly with the number of nodes. By chance it is small at one of them, and
larger again at the next: that is no reason to trust it. So what is stated of a number of nodes is
the largest error of it and all larger numbers that were tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Numbers tried beyond the most that may be taken. Rises above an earlier low last one to five
# numbers on gdi, methane-jet, droplets-only and an imported spray.
AHEAD = 8


def stays_K(errors_K: Sequence[float], count: int) -> float:
    """What the error stays below from `count` nodes on.

    Args:
        errors_K: of 1, 2, .. nodes.
        count: at least 1, at most as many as there are errors.
    """
    return float(max(errors_K[count - 1 :]))


def enough(errors_K: Sequence[float], *, bound_K: float, most: int) -> int:
    """The smallest number of nodes from which the error stays within a bound.

    Where no number does, it is the smallest number whose error stays as small as that of `most`.

    Args:
        errors_K: of 1, 2, .. nodes; the more there are beyond `most`, the surer is the choice.
        bound_K: what the error is to stay within.
        most: nodes at most.
    """
    stays = np.maximum.accumulate(np.asarray(errors_K, float)[::-1])[::-1][:most]
    return 1 + int(np.flatnonzero(stays <= max(bound_K, float(stays[-1])))[0])
