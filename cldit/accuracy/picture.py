"""A traced picture with its halves, and how far two pictures' T_app are apart beyond their noise.

Ordinates and paths err by chance, and in cells of another size they err otherwise. So the
difference of two pictures holds the noise of both. Each picture is the mean of two halves, A and B,
whose ordinates and paths are independent. So the product of the differences of the A and of the B
has the square of the true difference for its mean, whatever the noise is. With d the difference of
the pictures and e that of half of A - B, the product is (d + e)(d - e).

Pictures may be of drawn pixels (`cldit.accuracy.drawn_pixels`). A sum of theirs has an error of
sampling as well: where a few pixels hold most of a square, the sum is large or small by which were
drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.drawn_pixels import DrawnPixels
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.radiance.weights import Image, Weights
from cldit.transport.result import Subpixels, Trace

Floats = NDArray[np.float64]

_NEARBY = 0.05  # of the picture's edge: that of a block whose pixels may err together


@dataclass(frozen=True)
class Picture:
    """Weights (H, W) of one wavelength.

    difference: half the difference of the images by either half; None where nothing is by chance.
    subpixels: some of its pixels by many more rays; None: it was not asked for.
    """

    weights: Weights
    difference: Weights | None = None
    subpixels: Subpixels | None = None

    @classmethod
    def of(cls, result: Trace) -> Picture:
        """What a trace holds of it."""
        return cls(result.weights, result.weights_difference, result.subpixels)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(H, W) which pixels have an emissivity above 0.05."""
        return np.asarray(1.0 - self.weights.background > VISIBLE_EMISSIVITY)

    def map(self, change: Callable[[Image], Any]) -> Picture:
        """`change` of every image, which is not of the same pixels then."""
        difference = None if self.difference is None else self.difference.map(change)
        return Picture(self.weights.map(change), difference)

    def noise_K(self, temperature: NodeTemperature) -> Floats:
        """(H, W) half the difference of the halves' T_app: the picture's own error is as large."""
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
        """RMS of `noise_K` over the pixels of emissivity above 0.05; None: there is none.

        Args:
            temperature: of the scene and wavelength.
            drawn: the pixels that the picture is of; None: all.
        """
        noise = self.noise_K(temperature)
        known = np.isfinite(noise) & self.visible
        if not known.any():
            return None
        weight = None if drawn is None else 1.0 / drawn.chance[known]
        return float(np.sqrt(np.average(noise[known] ** 2, weights=weight)))


@dataclass(frozen=True)
class Step:
    """Difference of T_app of two pictures.

    error_K: RMS over the pixels of emissivity above 0.05 in both, without the pictures' noise, and
    one standard error of its square added; None: there is no pixel. map_K: (H, W) size of the
    difference in each of them that was traced, noise and all, NaN elsewhere.
    """

    error_K: float | None
    map_K: Floats

    def times(self, factor: float) -> Step:
        """The difference, scaled."""
        error_K = None if self.error_K is None else factor * self.error_K
        return Step(error_K, factor * self.map_K)

    @classmethod
    def between(
        cls,
        temperature: NodeTemperature,
        one: Picture,
        other: Picture,
        drawn: DrawnPixels | None = None,
    ) -> Step:
        """Compares two pictures.

        The square of (A^2 - B^2) / 2, summed over pixels that err together, has the variance of the
        sum of A B for its mean where there is noise alone. Of pixels that are drawn with a chance
        of p, the sum of (1 - p) (A B - mean)^2 / p^2 is the variance by which were drawn; what
        noise adds to it is in the first sum already, and is taken off.

        Args:
            temperature: of the scene and wavelength.
            one, other: of the same pixels.
            drawn: these pixels; None: all of the picture.
        """
        apart = temperature(one.weights) - temperature(other.weights)
        noise = one.noise_K(temperature) - other.noise_K(temperature)
        both = np.isfinite(apart) & np.isfinite(noise) & one.visible & other.visible
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
