"""Correlation of the errors of neighbouring pixels, from their standardised residuals.

The correlation rho(d) at a distance d is 1 - v(d), with the semivariance v(d) = <(z_i - z_j)^2> / 2
and the sill 1 that errors of the stated size have: a smooth difference does not change v at short
distances, and is not mistaken for a correlation. It is averaged over all directions and counts up
to the first distance at which it is within its noise: each pair alone is too noisy, while their sum
increases the variance of a mean tenfold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from cldit.arrays import Floats

_FARTHEST = 0.125  # largest distance of a correlation, of the image's edge
_KNOWN_SILL = 3.0  # variance of rho times pairs, of white noise with a known sill; else 1


def correlation(z: Floats) -> tuple[float, float]:
    """Sums over the distances of rho^2 and of rho, 1 without correlation; see the module.

    z: (H, W) standardised residuals, NaN where there is none.
    """
    known = np.isfinite(z)
    rows, columns = (np.ptp(np.flatnonzero(known.any(axis=axis))) + 1 for axis in (1, 0))
    far = max(1, round(_FARTHEST * max(rows, columns)))
    shape = [next_fast_len(n + far, real=True) for n in z.shape]
    mask, value = known.astype(float), np.where(known, z, 0.0)
    of_mask, of_value, of_square = (rfft2(one, shape) for one in (mask, value, value**2))

    def sums(one: NDArray[np.complex128], other: NDArray[np.complex128]) -> Floats:
        """Sums over pairs of pixels, by their distance; rows, then columns, up to `far`."""
        whole = irfft2(np.conj(one) * other, shape)
        near = np.concatenate([whole[-far:], whole[: far + 1]])
        return np.concatenate([near[:, -far:], near[:, : far + 1]], axis=1)

    pairs = np.rint(sums(of_mask, of_mask))
    square, product = sums(of_square, of_mask), sums(of_value, of_value)
    both = square + square[::-1, ::-1]
    half = 0.5 * both - product
    mean = float(np.mean(z[known] ** 2))
    if not mean > 0.0:
        return float(known.sum()), float(known.sum())  # equal: as good as one pixel
    down, across = np.indices(pairs.shape) - far
    ring = np.rint(np.hypot(down, across)).astype(int)
    count = np.bincount(ring.ravel(), pairs.ravel())
    rho = 1.0 - np.bincount(ring.ravel(), half.ravel()) / np.maximum(count, 1.0) / min(mean, 1.0)
    noise = np.sqrt((_KNOWN_SILL if mean >= 1.0 else 1.0) * 2.0 / np.maximum(count, 1.0))
    near = np.cumprod((rho > noise) & (count > 0))[1 : far + 1]  # up to the first by chance
    rho, weight = rho[1 : far + 1] * near, count[1 : far + 1] / pairs[far, far]
    return 1.0 + float(weight @ rho**2), 1.0 + float(weight @ rho)
