"""Number of spectral nodes: the smallest from which the error stays within a bound.

The error does not decrease monotonically with the number of nodes: by chance it may be small for
one number and larger for the next. The error stated for a number of nodes is therefore the largest
of its own and those of all larger numbers tried.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

# Numbers tried beyond the most that may be taken. Rises above an earlier low last one to five
# numbers on gdi, methane-jet, droplets-only and an imported spray.
AHEAD = 8


def stays_K(errors_K: Sequence[float], count: int) -> float:
    """Largest error from `count` nodes on; `errors_K` are those of 1, 2, .. nodes."""
    return float(max(errors_K[count - 1 :]))


def enough(errors_K: ArrayLike, *, bound_K: float, limit: int) -> int:
    """The smallest number of nodes, up to `limit`, from which the error stays within a bound.

    If there is none, it is the smallest number whose error stays as small as that of `limit`.
    Errors of numbers beyond `limit` make the choice more certain.
    """
    stays = np.maximum.accumulate(np.asarray(errors_K, float)[::-1])[::-1][:limit]
    return 1 + int(np.flatnonzero(stays <= max(bound_K, float(stays[-1])))[0])
