"""Two ensembles of injections, compared by permutation of their members between the sides.

If both are injections of the same spray, each division of all members into sides of these sizes is
as probable as the true one: p is the share of divisions whose statistic is at least as large, with
no assumption on the distribution of injections (Fisher 1935; Good 2005). The statistic is
Hotelling's T^2 of the largest principal components of all members. With the scatter of all members
as the unit, which no division changes, T^2 rises with the squared distance of the two means.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from cldit.arrays import Floats

_MOST = 3  # components, and at most a quarter of the members
_EXACT = 5000  # divisions that are all tried; else so many are drawn
_SEED = 1


def permutation_p(one: Floats, other: Floats) -> float:
    """Probability that two samples (n, N) and (m, N) of images differ as much by chance."""
    both = np.concatenate([one, other])
    both = both - both.mean(axis=0)
    squares, turn = np.linalg.eigh(both @ both.T)
    count = min(_MOST, len(both) // 4)
    kept = [k for k in np.argsort(squares)[::-1][:count] if squares[k] > 1e-12 * squares.sum()]
    scores = turn[:, kept]  # of variance 1 / (n + m - 1) each
    if not kept:
        return 1.0

    def statistic(sides: Floats) -> Floats:
        """Squared sums (P,) of scores, of mean 0, over the members marked in (P, n + m)."""
        return np.asarray(np.sum((sides @ scores) ** 2, axis=1))

    marked = np.zeros((1, len(both)))
    marked[0, : len(one)] = 1.0
    true = float(statistic(marked)[0]) * (1.0 - 1e-9) - 1e-12
    if math.comb(len(both), len(one)) <= _EXACT:
        every = list(combinations(range(len(both)), len(one)))
        sides = np.zeros((len(every), len(both)))
        np.put_along_axis(sides, np.array(every), 1.0, axis=1)
        return float(np.mean(statistic(sides) >= true))
    rng = np.random.default_rng(_SEED)
    sides = rng.permuted(np.repeat(marked, _EXACT, axis=0), axis=1)
    return float((1 + np.count_nonzero(statistic(sides) >= true)) / (1 + _EXACT))
