"""Sampling of pixels with unequal probabilities, to estimate sums over the image."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask

_ALIKE = 16  # sampled pixels: their mean square is known to a third
# Of the mean square, which all pixels have: sampled pixels are alike in part only, and an error
# that one pixel in fifty has, such as of a hole that most rays miss, is in few of sixteen.
_EVEN = 0.2


@dataclass(frozen=True)
class PixelSample:
    """Sample of an image's pixels.

    pixels: (N,) flat numbers, ascending.
    chance: (N,) inclusion probabilities, 0 to 1.
    """

    pixels: Ints
    chance: Floats

    @classmethod
    def of(cls, importance: Floats, *, size: int, seed: int) -> "PixelSample":
        """Systematic sampling with probabilities proportional to importance (P,), up to 1.

        Pixels are drawn at equal steps of the cumulative probability from a random start, so that
        neighbours, which are similar, are seldom drawn together. About `size` are drawn, or all of
        importance above 0 if there are no more.
        """
        listed = np.flatnonzero(importance > 0)
        weight = importance[listed].astype(np.float64)
        sure = np.full(len(listed), len(listed) <= size)
        chance = np.ones(len(listed))
        while not sure.all():
            remaining = size - np.count_nonzero(sure)
            chance[~sure] = remaining * weight[~sure] / weight[~sure].sum()
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

    def mean_square(self, error_1: Floats, error_2: Floats, *, count: int) -> tuple[float, float]:
        """Unbiased estimate of the mean square of an error over `count` pixels of an image.

        `error_1` and `error_2` (N,) are estimates of the error with independent noise, 0 where it
        does not count. Noise may make the mean square negative. The second result is its standard
        error.
        """
        total, doubt = self.total(error_1 * error_2, _of_product(error_1, error_2))
        return total / count, doubt / count

    def pick(self, image: NDArray[Any]) -> NDArray[Any]:
        """Pixels of the sample (1, N) in an image (H, W)."""
        return image.reshape(1, -1)[:, self.pixels]

    def by_noise(self, error_1: Floats, error_2: Floats) -> float:
        """Share, 0 to 1, of the variance of `mean_square` due to the noise of the estimates.

        The rest is due to the choice of the pixels. The noise of a drawn pixel contributes to the
        sum over all with the square of 1 / chance.
        """
        variance = _of_product(error_1, error_2)
        doubt = self.total(error_1 * error_2, variance)[1]
        noise = float(np.sum(variance / self.chance**2))
        return min(noise / doubt**2, 1.0) if doubt > 0.0 else 0.0


def _of_product(value_1: Floats, value_2: Floats) -> Floats:
    """Estimate of the variance of the product of two numbers with the same mean and noise."""
    return (value_1**2 - value_2**2) ** 2 / 4


def sampled_square(
    sample: PixelSample, square: Floats, features: tuple[Floats, ...], counted: Mask
) -> Floats:
    """Mean square (H, W) of the error in pixels like each pixel; NaN in pixels that do not count.

    It is that of the sampled pixels that are most alike: near in the image, of similar features.

    Args:
        sample: pixels that were measured.
        square: (N,) unbiased estimates of the square in each; noise may make them negative.
        features: (H, W) each, of which only the order counts; finite where `counted` is true.
        counted: (H, W) pixels with a T_app.
    """
    out = np.full(counted.shape, np.nan)
    counted_pixels, inside = np.flatnonzero(counted), counted.ravel()[sample.pixels]
    if not inside.any():
        return out
    place = np.argwhere(counted) / max(counted.shape)
    values = [feature[counted] for feature in features]
    ranks = [
        np.searchsorted(np.sort(feature_values), feature_values) / len(counted_pixels)
        for feature_values in values
    ]
    points = np.column_stack([place, *ranks])
    measured_points = points[np.searchsorted(counted_pixels, sample.pixels[inside])]
    count = min(_ALIKE, len(measured_points))
    tree = scipy.spatial.cKDTree(measured_points)
    nearest = tree.query(points, count)[1].reshape(len(points), count)
    alike = square[inside][nearest]
    # A standard error is added, as to the sum over the image.
    doubt = alike.std(axis=1) / max(count - 1, 1) ** 0.5
    smoothed = np.maximum(alike.mean(axis=1) + doubt, 0.0)
    out[counted] = (1.0 - _EVEN) * smoothed + _EVEN * smoothed.mean()
    return out
