"""Maps of the standard error of T_app in every pixel, by source and in total.

A difference of two images is one sample of an error, small by chance in some pixels. The map of a
source is therefore the local RMS of its differences, scaled so that the RMS over all pixels with a
T_app is the error that the run states.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from cldit.accuracy.errors import Errors
from cldit.arrays import Floats

Image = NDArray[np.float32]
TOTAL = "total"
_NEARBY = 0.05  # of the image's edge: edge of the square of the local RMS


def error_maps(
    errors: Errors, differences_K: Mapping[str, Floats], counted: NDArray[np.bool_]
) -> dict[str, Image]:
    """Standard errors (H, W) float32 by source, and their total; NaN in pixels that do not count.

    `differences_K` are sizes of differences (H, W) by source, NaN where unknown; `counted` (H, W)
    are the pixels with a T_app. Sources without a map have the same error everywhere in the total,
    and no map of their own.
    """
    if not counted.any() or errors.total_K is None:
        return {}
    out: dict[str, Image] = {}
    square = np.zeros(counted.shape)
    for cause in errors.causes:
        if cause.error_K is None:
            continue
        given = differences_K.get(cause.name)
        one = None if given is None else _nearby(given, counted)
        if one is None:
            square += cause.error_K**2
            continue
        rms = float(np.sqrt(np.mean(one[counted] ** 2)))
        one *= cause.error_K / rms if rms > 0 else 0.0
        square += one**2
        out[cause.name] = np.where(counted, one, np.nan).astype(np.float32)
    out[TOTAL] = np.where(counted, np.sqrt(square), np.nan).astype(np.float32)
    return out


def _nearby(difference_K: Floats, counted: NDArray[np.bool_]) -> Floats | None:
    """Local RMS of a map; None if nothing of it is known."""
    known = np.isfinite(difference_K) & counted
    if not known.any():
        return None
    width = max(3, round(_NEARBY * max(counted.shape)))
    weight = uniform_filter(known.astype(float), width)
    square = uniform_filter(np.where(known, np.nan_to_num(difference_K) ** 2, 0.0), width)
    mean = float(np.mean(difference_K[known] ** 2))
    local = np.divide(square, weight, out=np.full(square.shape, mean), where=weight > 1e-3)
    return np.asarray(np.sqrt(np.maximum(local, 0.0)))  # running sums leave rounding below 0
