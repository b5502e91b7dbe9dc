"""An image with its independent halves, and the difference of two images' T_app beyond noise.

Ordinates and paths have random errors, which differ with the size of the cells. So the difference
of two images contains the noise of both. Each image is the mean of two halves, A and B, whose
ordinates and paths are independent. The product of the difference of the A and that of the B
therefore has the square of the true difference as its mean, whatever the noise is. With d the
difference of the images and e that of half of A - B, the product is (d + e)(d - e).

Images may be of drawn pixels (`cldit.accuracy.drawn_pixels`). A sum over these also has a sampling
error: where a few pixels hold most of a square, the sum depends on whether they were drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.accuracy.drawn_pixels import DrawnPixels
from cldit.arrays import Floats, Ints, Mask
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.radiance.weights import Image, Weights
from cldit.transport.result import Subpixels, Trace

_NEARBY = 0.05  # of the image's edge: size of a block whose pixels may have a common error


@dataclass(frozen=True)
class ImagePair:
    """Weights (H, W) of one wavelength, as the mean of two independent halves.

    difference: half the difference of the halves; None where nothing is random. subpixels: some
    pixels by many more rays; None: not asked for. rays: (H, W) rays across each pixel; None: those
    of the scene.
    """

    weights: Weights
    difference: Weights | None = None
    subpixels: Subpixels | None = None
    rays: Ints | None = None

    @classmethod
    def of(cls, result: Trace) -> ImagePair:
        """The images of a trace."""
        difference = result.weights_difference
        return cls(result.weights, difference, result.subpixels, result.rays)

    @classmethod
    def middle_of(cls, result: Trace) -> ImagePair:
        """The images of a trace by one ray through the middle of each pixel."""
        if result.middle is None:
            return cls.of(result)
        return cls(result.middle, result.middle_difference)

    def visible(self, temperature: NodeTemperature) -> Mask:
        """(H, W) pixels whose emissivity at this wavelength is that of a pixel with a T_app."""
        return np.asarray(1.0 - self.weights.background > temperature.visible)

    def map(self, change: Callable[[Image], Any]) -> ImagePair:
        """Applies `change` to every image; the result has other pixels, and no subpixels."""
        difference = None if self.difference is None else self.difference.map(change)
        return ImagePair(self.weights.map(change), difference)

    def noise_K(self, temperature: NodeTemperature) -> Floats:
        """(H, W) half the difference of the halves' T_app, an estimate of the mean's error."""
        if self.difference is None:
            return np.zeros(self.weights.background.shape)
        mean, half = self.weights.images, self.difference.images
        one, other = (
            temperature(Weights.of({name: mean[name] + sign * half[name] for name in mean}))
            for sign in (1, -1)
        )
        return (one - other) / 2.0

    def error_K(
        self, temperature: NodeTemperature, drawn: DrawnPixels | None = None
    ) -> float | None:
        """RMS of `noise_K` over the visible pixels, all or drawn; None if there is none."""
        noise = self.noise_K(temperature)
        known = np.isfinite(noise) & self.visible(temperature)
        if not known.any():
            return None
        weight = None if drawn is None else 1.0 / drawn.chance[known]
        return float(np.sqrt(np.average(noise[known] ** 2, weights=weight)))


@dataclass(frozen=True)
class ImageDifference:
    """Difference of T_app between two images.

    error_K: RMS over the pixels that are visible in both, without noise, plus one standard error
    of its square; None: no such pixel. map_K: (H, W) size of the difference in each of them,
    noise included, NaN elsewhere.
    """

    error_K: float | None
    map_K: Floats

    def times(self, factor: float) -> ImageDifference:
        """Scales the difference."""
        error_K = None if self.error_K is None else factor * self.error_K
        return ImageDifference(error_K, factor * self.map_K)

    @classmethod
    def between(
        cls,
        temperature: NodeTemperature,
        one: ImagePair,
        other: ImagePair,
        drawn: DrawnPixels | None = None,
    ) -> ImageDifference:
        """Compares two images of the same pixels, all of an image or drawn.

        For noise alone, the square of (A^2 - B^2) / 2, summed over pixels with a common error, has
        the variance of the sum of A B as its mean. For pixels drawn with chance p, the sum of
        (1 - p) (A B - mean)^2 / p^2 is the variance by the draw; the contribution of noise to it
        is already in the first sum, and is subtracted.
        """
        apart = temperature(one.weights) - temperature(other.weights)
        noise = one.noise_K(temperature) - other.noise_K(temperature)
        both = np.isfinite(apart) & np.isfinite(noise)
        both &= one.visible(temperature) & other.visible(temperature)
        map_K = np.where(both, np.abs(apart), np.nan)
        shape, chance = both.shape, np.ones(both.shape)
        row, column = np.nonzero(both)
        if drawn is not None:
            map_K, shape, chance = drawn.spread(map_K), drawn.shape, drawn.chance
            row, column = (place[both[0]] for place in drawn.places)
        if not both.any():
            return cls(None, map_K)
        d, e, p = apart[both], noise[both], chance[both]
        count = float(np.sum(1.0 / p))
        product, doubt = d**2 - e**2, 2.0 * d * e
        total = float(np.sum(product / p))
        edge = max(1, round(_NEARBY * max(shape)))
        blocks = np.bincount(row // edge * shape[1] + column // edge, doubt / p)
        missed = (1.0 - p) / p**2 * ((product - total / count) ** 2 - doubt**2)
        variance = float(np.sum(blocks**2)) + max(float(np.sum(missed)), 0.0)
        return cls(((max(total, 0.0) + variance**0.5) / count) ** 0.5, map_K)
