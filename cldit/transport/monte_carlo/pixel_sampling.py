"""Sampling of pixels with unequal probabilities, to estimate sums over the image."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints


@dataclass(frozen=True)
class PixelSample:
    """Sample of an image's pixels.

    pixels: (N,) flat numbers, ascending.
    chance: (N,) inclusion probabilities, 0 to 1.
    """

    pixels: Ints
    chance: Floats

    @classmethod
    def of(cls, importance: Floats, *, most: int, seed: int) -> "PixelSample":
        """Systematic sampling with probabilities proportional to importance (P,), up to 1.

        Pixels are drawn at equal steps of the cumulative probability from a random start, so that
        neighbours, which are similar, are seldom drawn together. About `most` are drawn, or all of
        importance above 0 if there are no more.
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
        """Unbiased estimate of the sum over all pixels of importance above 0 (Horvitz-Thompson).

        `variance` (N,) is that of the noise of the `values` (N,), or an unbiased estimate of it.
        The second result is the standard error. The scatter of the values gives the sampling error
        (Hajek, Ann. Math. Statist. 35, 1964); pixels of probability 1 add only their noise.
        """
        scaled, free = values / self.chance, 1.0 - self.chance
        count = int(np.count_nonzero(free > 0))
        middle = np.average(scaled, weights=free) if count else 0.0
        missed = float(np.sum(free * (scaled - middle) ** 2)) * count / max(count - 1, 1)
        return float(scaled.sum()), (missed + float(np.sum(variance / self.chance))) ** 0.5

    def mean_square(self, one: Floats, other: Floats, *, count: int) -> tuple[float, float]:
        """Unbiased estimate of the mean square of an error over `count` pixels of an image.

        `one` and `other` (N,) are estimates of the error with independent noise, 0 where it does
        not count. Noise may make the mean square negative. The second result is its standard error.
        """
        total, doubt = self.total(one * other, _of_product(one, other))
        return total / count, doubt / count

    def pick(self, image: NDArray[Any]) -> NDArray[Any]:
        """Pixels of the sample (1, N) in an image (H, W)."""
        return image.reshape(1, -1)[:, self.pixels]

    def by_noise(self, one: Floats, other: Floats) -> float:
        """Share, 0 to 1, of the variance of `mean_square` due to the noise of the estimates.

        The rest is due to the choice of the pixels. The noise of a drawn pixel contributes to the
        sum over all with the square of 1 / chance.
        """
        variance = _of_product(one, other)
        doubt = self.total(one * other, variance)[1]
        noise = float(np.sum(variance / self.chance**2))
        return min(noise / doubt**2, 1.0) if doubt > 0.0 else 0.0


def _of_product(one: Floats, other: Floats) -> Floats:
    """Estimate of the variance of the product of two numbers with the same mean and noise."""
    return (one**2 - other**2) ** 2 / 4
