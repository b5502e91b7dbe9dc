"""Photon transfer curve: gain and read noise of a camera from the variance of its images.

Electrons follow a Poisson distribution, so the variance of one exposure in counts^2 rises by
1 / (electrons per count) per count (Janesick, Photon Transfer, SPIE 2007, Ch. 5). The variance
without light is that of read noise and rounding.
"""

import numpy as np
from scipy.special import chdtri

from cldit.arrays import Floats
from cldit.errors import EvaluationError

_BINS = 24  # of equal numbers of pixels


def photon_transfer(
    mean: Floats,
    variance: Floats,
    *,
    exposures: int,
    offset_counts: float | None,
    step_counts: float = 1.0,
) -> dict[str, float]:
    """Gain, read noise and offset, as `Calibration` names them, from equal exposures.

    Pixels are sorted by their mean into bins; the variance of a bin is the median of its pixels'
    variances over the median of chi-square, which is robust against defective pixels.

    Args:
        mean, variance: (N,) counts, counts^2, of one exposure, at any levels of light.
        exposures: number per pixel, 2 or more.
        offset_counts: counts without light. None: counts at which the variance is that of rounding;
            the offset then includes the read noise, with the same errors as a result.
        step_counts: to which images are rounded.
    """
    order = np.argsort(mean)
    bins = [part for part in np.array_split(order, _BINS) if part.size]
    correction = float(chdtri(exposures - 1, 0.5)) / (exposures - 1)
    level = np.array([np.mean(mean[part]) for part in bins])
    noise = np.array([np.median(variance[part]) for part in bins]) / correction
    if len(bins) < 2 or not np.ptp(level) > 0.0 or not np.all(noise > 0.0):
        raise EvaluationError(
            "sensor: noise cannot be estimated from references that are equal; give "
            "sensor.electrons_per_count and read_noise_electrons"
        )
    slope, at_zero = np.polyfit(level, noise, 1, w=1.0 / noise)
    if not slope > 0.0:
        raise EvaluationError(
            "sensor: the references' variance does not rise with their counts, as photon noise "
            "does; give sensor.electrons_per_count and read_noise_electrons"
        )
    offset = offset_counts
    if offset is None:
        offset = (step_counts**2 / 12.0 - at_zero) / slope
    read2 = at_zero + slope * offset - step_counts**2 / 12.0
    return {
        "electrons_per_count": float(1.0 / slope),
        "read_noise_electrons": float(np.sqrt(max(read2, 0.0)) / slope),
        "offset_counts": float(offset),
    }
