"""Drawn pixels of a large image, which stand for all in coarse traces.

Most of the difference between two images may lie in a hundredth of the pixels that see the medium,
and the medium in a hundredth of the image. So most pixels are drawn from those that are likely to
see it, and a tenth from all in front of the background. A sum over the image is that over the drawn
pixels, each over its chance (Horvitz and Thompson, J. Am. Stat. Assoc. 47, 663, 1952), which is
unbiased whatever the chances are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats, Image, Ints, Mask
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.transport.monte_carlo.pixel_sampling import PixelSample

_WHOLE = 90_000  # pixels of an image, up to which all of them are traced
_MOST = 10_000  # else so many are drawn: the squares of a hundredth of them are known to a seventh
_EVEN = 0.1  # of the chance, which is equal for all pixels in front of the background
_LIKELY = 0.5  # of the least emissivity with a T_app, since larger cells smear it


@dataclass(frozen=True)
class DrawnPixels:
    """Pixels, with the chance of each, of an image whose `shape` is (rows, columns)."""

    shape: tuple[int, int]
    sample: PixelSample

    @classmethod
    def of(
        cls, sees_background: Mask, emissivity: NDArray[np.floating], *, seed: int
    ) -> DrawnPixels:
        """Draws pixels.

        `sees_background` (H, W) are the pixels that may have a T_app, and `emissivity` (h, w) is
        that of a coarse image of the same field.
        """
        rows, columns = sees_background.shape
        coarse = scipy.ndimage.maximum_filter(emissivity, 3) > _LIKELY * VISIBLE_EMISSIVITY
        down, across = (
            np.arange(count) * coarse_count // count
            for count, coarse_count in zip((rows, columns), coarse.shape, strict=True)
        )
        likely = (coarse[np.ix_(down, across)] & sees_background).astype(float)
        even = _EVEN * float(likely.sum() / max(sees_background.sum(), 1)) or 1.0
        importance = np.where(sees_background, likely + even, 0.0)
        return cls((rows, columns), PixelSample.of(importance.ravel(), size=_MOST, seed=seed))

    @property
    def chance(self) -> Floats:
        """(1, N) of each to be drawn."""
        return self.sample.chance[None]

    @property
    def places(self) -> tuple[Ints, Ints]:
        """Row and column in the image, each (N,)."""
        row, column = np.divmod(self.sample.pixels, self.shape[1])
        return row, column

    def pick(self, image: Image | Mask) -> Any:
        """Picks these pixels (1, N) of an image (H, W)."""
        return self.sample.pick(image)

    def spread(self, values: Floats) -> Floats:
        """An image (H, W) of values (1, N), NaN elsewhere."""
        out = np.full(self.shape, np.nan)
        out.flat[self.sample.pixels] = values[0]
        return out


def all_are_traced(pixels: tuple[int, int]) -> bool:
    """True if an image of (columns, rows) is so small that all of its pixels are traced."""
    return pixels[0] * pixels[1] <= _WHOLE
