"""Maps of the standard error of T_app in every pixel, by source and in total.

A difference of two images is one sample of an error, small by chance in some pixels. The map of a
source is therefore the local RMS of its differences, scaled so that the RMS over all pixels with a
T_app is the error that the run states. An error that two images share is not in the map of their
difference. Where a sample of pixels measures it, the mean square of the sampled pixels that are
most alike is taken for each pixel: near in the image, of similar emissivity and contrast.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from cldit.accuracy.errors import Errors
from cldit.arrays import Floats, Mask
from cldit.transport.monte_carlo.pixel_sampling import PixelSample

Image = NDArray[np.float32]
TOTAL = "total"
_NEARBY = 0.03  # of the image's edge: of each square whose means make the local RMS


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
    weight, square = known.astype(float), np.where(known, np.nan_to_num(difference_K) ** 2, 0.0)
    for _ in range(3):  # three means in squares weigh nearly as a round Gaussian
        weight, square = uniform_filter(weight, width), uniform_filter(square, width)
    mean = float(np.mean(difference_K[known] ** 2))
    local = np.divide(square, weight, out=np.full(square.shape, mean), where=weight > 1e-3)
    return np.asarray(np.sqrt(np.maximum(local, 0.0)))  # running sums leave rounding below 0


_ALIKE = 16  # sampled pixels: their mean square is known to a third
_EVEN = 0.1  # of the mean square, which all pixels have: sampled pixels are alike in part only


def sampled_square(
    sample: PixelSample, square: Floats, features: tuple[Floats, ...], counted: Mask
) -> Floats:
    """Mean square (H, W) of the error in pixels like each pixel; NaN in pixels that do not count.

    Args:
        sample: pixels that were measured.
        square: (N,) unbiased estimates of the square in each; noise may make them negative.
        features: (H, W) each, of which only the order counts; finite where `counted` is true.
        counted: (H, W) pixels with a T_app.
    """
    out = np.full(counted.shape, np.nan)
    here, inside = np.flatnonzero(counted), counted.ravel()[sample.pixels]
    if not inside.any():
        return out
    place = np.argwhere(counted) / max(counted.shape)
    values = [feature[counted] for feature in features]
    ranks = [np.searchsorted(np.sort(one), one) / len(here) for one in values]
    points = np.column_stack([place, *ranks])
    known = points[np.searchsorted(here, sample.pixels[inside])]
    count = min(_ALIKE, len(known))
    near = cKDTree(known).query(points, count)[1].reshape(len(points), count)
    alike = square[inside][near]
    # A standard error is added, as to the sum over the image.
    doubt = alike.std(axis=1) / max(count - 1, 1) ** 0.5
    found = np.maximum(alike.mean(axis=1) + doubt, 0.0)
    out[counted] = (1.0 - _EVEN) * found + _EVEN * found.mean()
    return out
