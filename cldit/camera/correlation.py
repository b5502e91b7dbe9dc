"""Correlation of the errors of neighbouring pixels, from their standardised residuals.

The correlation rho(d) at a distance d is 1 - v(d) / s, with the semivariance
v(d) = <(z_i - z_j)^2> / 2 and the sill s. It is the mean of z^2, of which chance makes v and s
large together: with a sill of 1 an image whose errors are large by chance would seem to have no
correlation, just where it decides. It is at most what independent errors of the stated size reach
by chance, 3 standard deviations above 1: a smooth difference makes the mean of z^2 larger, does
not change v at short distances, and is not mistaken for a correlation. It is averaged over all
directions and counts up to the first distance at which it is within its noise: each pair alone is
too noisy, while their sum increases the variance of a mean tenfold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from cldit.arrays import Floats

_FARTHEST = 0.25  # largest distance of a correlation, of the image's edge
_BY_CHANCE = 3.0  # standard deviations of a mean square


def correlation(z: Floats) -> tuple[float, float]:
    """Sums over the distances of rho^2 and of rho, 1 without correlation; see the module.

    z: (H, W) standardised residuals, NaN where there is none.
    """
    valid = np.isfinite(z)
    rows, columns = (np.ptp(np.flatnonzero(valid.any(axis=axis))) + 1 for axis in (1, 0))
    reach = max(1, round(_FARTHEST * max(rows, columns)))
    shape = [next_fast_len(n + reach, real=True) for n in z.shape]
    mask, value = valid.astype(float), np.where(valid, z, 0.0)
    of_mask, of_value, of_square = (rfft2(image, shape) for image in (mask, value, value**2))

    def sums(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> Floats:
        """Sums over pairs of pixels, by their distance; rows, then columns, up to `reach`."""
        correlated = irfft2(np.conj(a) * b, shape)
        rows_within = np.concatenate([correlated[-reach:], correlated[: reach + 1]])
        return np.concatenate([rows_within[:, -reach:], rows_within[:, : reach + 1]], axis=1)

    pairs = np.rint(sums(of_mask, of_mask))
    square, product = sums(of_square, of_mask), sums(of_value, of_value)
    symmetric = square + square[::-1, ::-1]
    half = 0.5 * symmetric - product
    mean = float(np.mean(z[valid] ** 2))
    if not mean > 0.0:
        return float(valid.sum()), float(valid.sum())  # equal: as good as one pixel
    largest_sill = 1.0 + _BY_CHANCE * (2.0 / np.count_nonzero(valid)) ** 0.5
    down, across = np.indices(pairs.shape) - reach
    ring = np.rint(np.hypot(down, across)).astype(int)
    count = np.bincount(ring.ravel(), pairs.ravel())
    semivariance = np.bincount(ring.ravel(), half.ravel()) / np.maximum(count, 1.0)
    rho = 1.0 - semivariance / min(mean, largest_sill)
    noise = np.sqrt(2.0 / np.maximum(count, 1.0))  # of white noise
    correlated = np.cumprod((rho > noise) & (count > 0))[1 : reach + 1]  # up to the first by chance
    rho, weight = rho[1 : reach + 1] * correlated, count[1 : reach + 1] / pairs[reach, reach]
    return 1.0 + float(weight @ rho**2), 1.0 + float(weight @ rho)
