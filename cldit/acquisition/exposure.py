"""Histogram of a shot's counts within the sensor's range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.quality import saturated_percent


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """Distribution of counts over the sensor's range.

    Attributes:
        pixels: (N,) number of pixels in N equal parts of 0..saturation_counts; the last one
            includes everything above.
        lowest, median, highest: in counts.
        saturation_counts, saturated_percent: level of a full pixel, and share of full pixels.
    """

    pixels: NDArray[np.int64]
    lowest: int
    median: float
    highest: int
    saturation_counts: int
    saturated_percent: float


def exposure(image: NDArray[np.uint16], *, saturation_counts: int, bins: int = 64) -> Exposure:
    """Exposure of a shot, (h, w) or (n, h, w) counts, in a histogram of `bins` parts."""
    clipped = np.minimum(image, saturation_counts)
    pixels, _ = np.histogram(clipped, bins, range=(0.0, float(max(saturation_counts, 1))))
    return Exposure(
        pixels=pixels.astype(np.int64),
        lowest=int(image.min()),
        median=float(np.median(image)),
        highest=int(image.max()),
        saturation_counts=saturation_counts,
        saturated_percent=saturated_percent(image, saturation_counts),
    )
