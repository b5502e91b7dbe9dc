"""Maps of the standard error of T_app or emissivity in every pixel, by source and in total.

A difference of two images is one sample of an error, small by chance in some pixels. The map of a
source is therefore the local RMS of its differences, scaled so that its RMS is the error that the
run states. An error that two images share is not in the map of their difference; where a sample of
pixels measures it, `sampled_square` has it in each pixel.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import scipy

from cldit.arrays import Floats, Image, Mask

TOTAL = "total"
_NEARBY = 0.03  # of the image's edge: of each square whose means make the local RMS
# Running sums along 1e4 pixels round to 1e-12 of the largest square; their ratio at this weight is
# good to 1e-6 of it.
_ROUNDING = 1e-6


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
        difference = differences.get(name, np.full(counted.shape, np.nan))
        local_map = np.nan_to_num(difference) if name in local else _nearby(difference, counted)
        if local_map is None:
            square += error**2 * of
            continue
        rms = float(np.sqrt(np.sum(local_map[counted] ** 2) / np.count_nonzero(of)))
        local_map *= error / rms if rms > 0 else 0.0
        square += local_map**2
        out[name] = np.where(counted, local_map, np.nan).astype(np.float32)
    out[TOTAL] = np.where(counted, np.sqrt(square), np.nan).astype(np.float32)
    return out


def _nearby(difference: Floats, counted: Mask) -> Floats | None:
    """Local RMS of a map; None if nothing of it is known. A pixel with no known pixel around it has
    the difference of the nearest known one."""
    sampled = np.isfinite(difference) & counted
    if not sampled.any():
        return None
    width = max(3, round(_NEARBY * max(counted.shape)))
    exact = np.where(sampled, np.nan_to_num(difference) ** 2, 0.0)
    weight, square = sampled.astype(float), exact
    for _ in range(3):  # three means in squares weigh nearly as a round Gaussian
        weight, square = (scipy.ndimage.uniform_filter(x, width) for x in (weight, square))
    local = np.divide(square, weight, out=np.zeros(square.shape), where=weight > _ROUNDING)
    isolated = weight <= _ROUNDING
    if isolated.any():
        nearest = scipy.ndimage.distance_transform_edt(
            ~sampled, return_distances=False, return_indices=True
        )
        row, column = nearest[:, isolated]
        local[isolated] = exact[row, column]
    return np.asarray(np.sqrt(np.maximum(local, 0.0)))  # running sums leave rounding below 0
