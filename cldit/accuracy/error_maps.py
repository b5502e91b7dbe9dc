"""Maps of the standard error of T_app or emissivity in every pixel, by source and in total.

A difference of two images is one sample of an error, small by chance in some pixels. The map of a
source is therefore the local RMS of its differences, scaled so that its RMS is the error that the
run states. An error that two images share is not in the map of their difference; where a sample of
pixels measures it, `sampled_square` has it in each pixel.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, uniform_filter

from cldit.arrays import Floats, Mask

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
        given = differences.get(name, np.full(counted.shape, np.nan))
        one = np.nan_to_num(given) if name in local else _nearby(given, counted)
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
    bare = weight <= 1e-3  # of known pixels: where few are drawn, the nearest square has the value
    nearest = distance_transform_edt(bare, return_distances=False, return_indices=True)
    local = np.divide(square, weight, out=np.zeros(square.shape), where=~bare)[tuple(nearest)]
    return np.asarray(np.sqrt(np.maximum(local, 0.0)))  # running sums leave rounding below 0
