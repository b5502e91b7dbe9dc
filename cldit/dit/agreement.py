"""Errors that agree with the residuals, where a check contradicts the measurement equation.

If the causes that were found do not explain a contradiction, the reduced chi-square of the pixels
remains above 1. Their covariance is then multiplied by its mean in the neighbourhood (Birge 1932).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.special import chdtrc

from cldit.dit.chance import FEW, IMPROBABLE, sure
from cldit.dit.maps import Maps, Reason
from cldit.dit.solve import DETECTION

_SIDE = 7  # pixels: the mean of chi-square over 49 of them, of 4 degrees, has an error of 0.1


def agreeing(maps: Maps, backgrounds: NDArray[np.int_]) -> tuple[Maps, str]:
    """Maps whose errors agree with the residuals, and a remark; unchanged if they do already.

    backgrounds: (H, W) number of backgrounds with a signal in each pixel.
    """
    tested = np.isfinite(maps.fit_probability)
    if not tested.any() or np.mean(maps.fit_probability[tested] < IMPROBABLE) < FEW:
        return maps, ""
    total = uniform_filter(np.where(tested, maps.reduced_chi2, 0.0).astype(float), _SIDE)
    mean = total / np.maximum(uniform_filter(tested.astype(float), _SIDE), 1.0 / _SIDE**2)
    degrees = np.maximum(2 * backgrounds - 4, 1)
    chance = 1.0 + sure(0) * np.sqrt(2.0 / (degrees * _SIDE**2))
    factor = np.where(tested & (mean > chance), mean, 1.0)
    if not np.any(factor > 1.0):
        return maps, ""
    wider = np.sqrt(factor).astype(np.float32)
    reduced = np.asarray(maps.reduced_chi2 / factor, np.float32)
    error = maps.emissivity_standard_error * wider
    faint = (maps.reason == Reason.OK) & ~(maps.emissivity > DETECTION * error)

    nothing = np.float32(np.nan)
    probability = np.where(tested, chdtrc(degrees, reduced * degrees), np.nan).astype(np.float32)
    widened = replace(
        maps,
        emissivity_standard_error=error,
        apparent_temperature_K=np.where(faint, nothing, maps.apparent_temperature_K),
        apparent_temperature_standard_error_K=np.where(
            faint, nothing, maps.apparent_temperature_standard_error_K * wider
        ),
        reason=np.where(faint, np.uint8(Reason.EMISSIVITY_TOO_LOW), maps.reason),
        reduced_chi2=reduced,
        fit_probability=probability,
    )
    share = float(np.mean(factor[tested] > 1.0))
    return widened, (
        f"no cause explains the residuals in {100.0 * share:.0f} % of the pixels: their errors are "
        f"widened by {float(np.median(wider[factor > 1.0])):.2g} (median) until they agree"
    )
