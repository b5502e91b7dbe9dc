"""Maps of the standard error of T_app or emissivity in every pixel, by source and in total.

A difference of two images is one sample of an error, small by chance in some pixels. The map of a
source is therefore the local RMS of its differences, scaled so that its RMS is the error that the
run states. An error that two images share is not in the map of their
difference. Where a sample of pixels measures it, the mean square of the sampled pixels that are
most alike is taken for each pixel: near in the image, of similar emissivity and contrast.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from cldit.arrays import Floats, Mask
from cldit.transport.monte_carlo.pixel_sampling import PixelSample

Image = NDArray[np.float32]
TOTAL = "total"
_NEARBY = 0.03  # of the image's edge: of each square whose means make the local RMS


def error_maps(
    errors: Mapping[str, float | None],
    differences: Mapping[str, Floats],
    counted: Mask,
    of: Mask | None = None,
    local: Collection[str] = (),
) -> dict[str, Image]:
    """Standard errors (H, W) float32 by source, and their total; NaN in pixels that do not count.

    `errors` are RMS values by source, over as many pixels as those `of` (H, W); None: those that
    are `counted` (H, W). `differences` are sizes of differences (H, W) by source, of any scale, NaN
    where unknown; those of `local` sources are RMS values already. Sources without a map have the
    same error in all pixels `of` in the total, and no map of their own.
    """
    of = counted if of is None else of
    if not of.any() or all(error is None for error in errors.values()):
        return {}
    out: dict[str, Image] = {}
    square = np.zeros(counted.shape)
    for name, error in errors.items():
        if error is None:
            continue
        given = differences.get(name)
        one = None if given is None else _nearby(given, counted)
        if given is not None and name in local:
            one = np.nan_to_num(given)
        if one is None:
            square += error**2 * of
            continue
        rms = float(np.sqrt(np.sum(one[counted] ** 2) / np.count_nonzero(of)))
        one *= error / rms if rms > 0 else 0.0
        square += one**2
        out[name] = np.where(counted, one, np.nan).astype(np.float32)
    out[TOTAL] = np.where(counted, np.sqrt(square), np.nan).astype(np.float32)
    return out


def _nearby(difference: Floats, counted: Mask) -> Floats | None:
    """Local RMS of a map; None if nothing of it is known."""
    known = np.isfinite(difference) & counted
    if not known.any():
        return None
    width = max(3, round(_NEARBY * max(counted.shape)))
    weight, square = known.astype(float), np.where(known, np.nan_to_num(difference) ** 2, 0.0)
    for _ in range(3):  # three means in squares weigh nearly as a round Gaussian
        weight, square = uniform_filter(weight, width), uniform_filter(square, width)
    mean = float(np.mean(difference[known] ** 2))
    local = np.divide(square, weight, out=np.full(square.shape, mean), where=weight > 1e-3)
    return np.asarray(np.sqrt(np.maximum(local, 0.0)))  # running sums leave rounding below 0


_ALIKE = 16  # sampled pixels: their mean square is known to a third
# Of the mean square, which all pixels have: sampled pixels are alike in part only, and an error
# that one pixel in fifty has, such as of a hole that most rays miss, is in few of sixteen.
_EVEN = 0.2


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
