"""Map of an error that was measured in a sample of an image's pixels.

An error that two images share is not in the map of their difference. Where a sample of pixels
measures it, the mean square of the sampled pixels that are most alike is taken for each pixel: near
in the image, of similar emissivity and of similar contrast.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import rankdata

from cldit.arrays import Floats, Mask
from cldit.transport.monte_carlo.pixel_sampling import PixelSample

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
    ranks = [rankdata(one[counted]) / len(here) for one in features]
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
