"""Some pixels of a picture, each drawn with a chance of its own, and what they say of all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PixelSample:
    """pixels: (N,) flat numbers, ascending; chance: (N,) with which each was drawn, 0 to 1."""

    pixels: NDArray[np.int64]
    chance: Floats

    @classmethod
    def of(cls, importance: Floats, *, most: int, seed: int) -> PixelSample:
        """About `most` of the pixels of importance above 0, all of them where they are no more.

        Chances are in proportion to importance (P,), up to 1. Drawn at even steps of the sum of
        chances from a start by chance: neighbours, which are alike, are seldom drawn together.
        """
        listed = np.flatnonzero(importance > 0)
        weight = importance[listed].astype(np.float64)
        sure = np.full(len(listed), len(listed) <= most)
        chance = np.ones(len(listed))
        while not sure.all():
            left = most - np.count_nonzero(sure)
            chance[~sure] = left * weight[~sure] / weight[~sure].sum()
            if not np.any(chance > 1.0):
                break
            sure |= chance > 1.0
            chance[sure] = 1.0
        start = np.random.default_rng(seed).random()
        steps = np.floor(np.cumsum(np.where(sure, 0.0, chance)) + start)
        drawn = sure | (np.diff(steps, prepend=0.0) > 0)
        return cls(listed[drawn], chance[drawn])

    def total(self, values: Floats, variance: Floats) -> tuple[float, float]:
        """Sum over all pixels of importance above 0, without bias, and its standard error.

        Args:
            values: (N,) of the pixels that were drawn, each with noise of its own of `variance`
                (N,), or an unbiased estimate of that.

        What was not drawn is told from the scatter of what was (Hajek 1964, chances unequal and
        their sum given); pixels drawn for sure add their noise alone.
        """
        scaled, free = values / self.chance, 1.0 - self.chance
        count = int(np.count_nonzero(free > 0))
        middle = np.average(scaled, weights=free) if count else 0.0
        missed = float(np.sum(free * (scaled - middle) ** 2)) * count / max(count - 1, 1)
        return float(scaled.sum()), (missed + float(np.sum(variance / self.chance))) ** 0.5
