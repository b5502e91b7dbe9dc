"""An image with its independent halves, and the difference of two images' results beyond noise.

The results are T_app and emissivity. Errors of emissivity are multiplied by
`kelvin_per_emissivity`, the ratio of the tolerances, so that both are compared in kelvin.

Ordinates and paths have random errors, which differ with the size of the cells. So the difference
of two images contains the noise of both. Each image is the mean of two halves, A and B, whose
ordinates and paths are independent. The product of the difference of the A and that of the B
therefore has the square of the true difference as its mean, whatever the noise is. With d the
difference of the images and e that of half of A - B, the product is (d + e)(d - e).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats, Image, Ints, Mask
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.radiance.weights import Weights
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
    def of(cls, result: Trace, *, middle: bool = False) -> ImagePair:
        """The images of a trace; `middle`: by one ray through the middle of each pixel, if those
        were traced."""
        if middle and result.middle is not None:
            return cls(result.middle, result.middle_difference)
        return cls(result.weights, result.weights_difference, result.subpixels, result.rays)

    def visible(self, temperature: NodeTemperature) -> Mask:
        """(H, W) pixels whose emissivity at this wavelength is that of a pixel with a T_app."""
        return np.asarray(1.0 - self.weights.background > temperature.visible)

    def map(self, change: Callable[[Image], Any]) -> ImagePair:
        """Applies `change` to every image; the result has other pixels, and no subpixels."""
        difference = None if self.difference is None else self.difference.map(change)
        return ImagePair(self.weights.map(change), difference)

    def noise_K(self, temperature: NodeTemperature) -> Floats:
        """(2, H, W) half the difference of the halves' results, estimates of the mean's error."""
        if self.difference is None:
            return np.zeros((2, *self.weights.background.shape))
        mean, half = self.weights.images, self.difference.images
        result_a, result_b = (
            np.stack(temperature.results(Weights.of({n: mean[n] + sign * half[n] for n in mean})))
            for sign in (1, -1)
        )
        return np.asarray((result_a - result_b) / 2.0)


@dataclass(frozen=True)
class ImageDifference:
    """Difference of one result between two images.

    error_K: RMS without noise, plus one standard error of its square; None: no pixel is visible.
    Of T_app it is taken over the pixels that are visible in both. Of emissivity all pixels in front
    of the background are in the sum of squares, and those visible in either are their number: a
    pixel may be clear in one image alone. map_K: (H, W) size of the difference in each pixel,
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
        image_a: ImagePair,
        image_b: ImagePair,
    ) -> tuple[ImageDifference, ImageDifference]:
        """Compares T_app and emissivity of two images of the same pixels.

        For noise alone, the square of (A^2 - B^2) / 2, summed over pixels with a common error, has
        the variance of the sum of A B as its mean.
        """
        results = (np.stack(temperature.results(image.weights)) for image in (image_a, image_b))
        change = np.subtract(*results)
        noise = image_a.noise_K(temperature) - image_b.noise_K(temperature)
        seen = image_a.visible(temperature), image_b.visible(temperature)
        finite = np.isfinite(change) & np.isfinite(noise)
        finite[0] &= seen[0] & seen[1]
        number = finite[0], finite[1] & (seen[0] | seen[1])
        warm, emissivity = zip(change, noise, finite, number, strict=True)
        return cls._of(*warm), cls._of(*emissivity)

    @classmethod
    def _of(cls, change: Floats, noise: Floats, finite: Mask, number: Mask) -> ImageDifference:
        """Takes differences and noise (H, W) of one result in `finite` pixels, and those that are
        their `number`."""
        map_K = np.where(finite, np.abs(change), np.nan)
        if not number.any():
            return cls(None, map_K)
        row, column = np.nonzero(finite)
        d, e = change[finite], noise[finite]
        edge = max(1, round(_NEARBY * max(finite.shape)))
        blocks = np.bincount(row // edge * finite.shape[1] + column // edge, 2.0 * d * e)
        square = max(float(np.sum(d**2 - e**2)), 0.0) + float(np.sum(blocks**2)) ** 0.5
        return cls((square / int(np.count_nonzero(number))) ** 0.5, map_K)
