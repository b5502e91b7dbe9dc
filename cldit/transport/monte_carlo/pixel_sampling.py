"""Sampling of pixels with unequal probabilities, to estimate sums over the image (audit)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PixelSample:
    """A sample of an image's pixels.

    pixels: (N,) flat numbers, ascending.
    chance: (N,) probability of each to be drawn, 0 to 1.
    """

    pixels: NDArray[np.int64]
    chance: Floats

    @classmethod
    def of(cls, importance: Floats, *, most: int, seed: int) -> PixelSample:
        """Systematic sampling with probabilities in proportion to importance, up to 1.

        Pixels are drawn at equal steps of the cumulative probability from a random start, so that
        neighbours, which are alike, are seldom drawn together.

        Args:
            importance: (P,); pixels of 0 are never drawn.
            most: about so many are drawn, or all of importance above 0 if they are no more.
            seed: of the random start.
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

        Args:
            values: (N,) of the pixels drawn.
            variance: (N,) of each value's own noise, or an unbiased estimate of it.

        Returns:
            The sum and its standard error. The scatter of the values gives the error of sampling
            (Hajek, Ann. Math. Statist. 35, 1964); pixels of probability 1 add their noise alone.
        """
        scaled, free = values / self.chance, 1.0 - self.chance
        count = int(np.count_nonzero(free > 0))
        middle = np.average(scaled, weights=free) if count else 0.0
        missed = float(np.sum(free * (scaled - middle) ** 2)) * count / max(count - 1, 1)
        return float(scaled.sum()), (missed + float(np.sum(variance / self.chance))) ** 0.5

    def mean_square(self, one: Floats, other: Floats, *, count: int) -> tuple[float, float]:
        """Unbiased estimate of the mean square of an error over an image.

        Args:
            one, other: (N,) two estimates of the error with independent noise; 0 where it is not
                counted.
            count: pixels of the image over which the mean is taken.

        Returns:
            Mean square, below 0 where noise has it so; and its standard error.
        """
        total, doubt = self.total(one * other, _of_product(one, other))
        return total / count, doubt / count

    def pick(self, image: NDArray[Any]) -> NDArray[Any]:
        """These pixels (1, N) of an image (H, W)."""
        return image.reshape(1, -1)[:, self.pixels]

    def by_noise(self, one: Floats, other: Floats) -> float:
        """Share of the variance of `mean_square` that less noise of the estimates would take away.

        The rest is by the choice of the pixels, and stays. The noise of a drawn pixel is in the sum
        over all with the square of 1 / chance.

        Args:
            one, other: (N,) as in `mean_square`.

        Returns:
            0 to 1; 0 where there is no variance at all.
        """
        variance = _of_product(one, other)
        doubt = self.total(one * other, variance)[1]
        noise = float(np.sum(variance / self.chance**2))
        return min(noise / doubt**2, 1.0) if doubt > 0.0 else 0.0


def _of_product(one: Floats, other: Floats) -> Floats:
    """Variance of the product of two numbers with the same mean and noise, estimated by them."""
    return (one**2 - other**2) ** 2 / 4
