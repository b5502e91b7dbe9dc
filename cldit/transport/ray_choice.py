"""Rays per pixel by the error of each pixel: `camera.rays_per_pixel: auto`.

Pixels start with one ray through the middle. The expected square of a pixel's error is in
proportion to the square of its difference from the neighbours. Where a pixel was traced with more
rays, the change of T_app measures it, in the pixel and around it: so a pixel that looks even by few
rays gets more if its neighbours change. Edges dominate, whose square falls with the number n of
rays as n^-3/2. The least number of rays for a given sum of squares is then in proportion to
e^(4/5), with e the error by one ray (Lagrange, as in Neyman's allocation). It is rounded to powers
of four, and pixels double their rays across until the expected sum is small enough. A sample of
pixels with many more rays then measures the sum without bias (subpixels.py), and if it is too
large, the expected squares are scaled and more rays follow.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy

from cldit.arrays import Floats, Ints, Mask, Reals
from cldit.optics.visible import VISIBLE_DISC
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.transport.image import Rays
from cldit.transport.view import View, dilated

MOST_ACROSS = 16
SHARES = 32  # rays across, without a medium, by which the share of the background is exact
_NUMBERS = (1, 2, 4, 8, MOST_ACROSS, SHARES)
_MOST_RAYS = 4, 1_000_000  # on average over the image, and beside that: a second or two
_FIRST = 0.2  # error by one ray over the difference from the neighbours, before it is measured
_LEAST, _LARGEST = 0.02, 1.0  # of that ratio, measured
_ORDER = 1.5  # of the square in the number of rays
_SAFE = 0.7  # of the allowed square, which the expected square aims at
_LEAST_SEEN = 0.25  # share of the background, by few rays, where exactly it is more than half
_MOST_SCALE = 4.0  # of the expected squares by one measurement, which has noise
_ROUNDS = 10


@dataclass(frozen=True)
class PixelResults:
    """Both results (2, ...) of pixels as DIT evaluates them: rim pixels by their excess over the
    reference. They are T_app, and emissivity times `temperature.per_emissivity_K`.

    rim: (H W,) pixels with other than the background around them.
    """

    view: View
    temperature: TraceTemperature
    rim: Mask
    _known: dict[int, Floats] = field(default_factory=dict)  # shares by number of rays across

    @classmethod
    def of(cls, view: View, temperature: TraceTemperature) -> "PixelResults":
        """Finds the pixels at the rim of the background."""
        rim = dilated(~view.sees_background, 1 + view.edge_pixels)
        return cls(view, temperature, rim.reshape(-1))

    def _shares(self, pixels: Ints, across: Ints) -> Floats:
        """Shares (B, N) of the boundary in rim pixels (N,) that see the background.

        All such pixels are traced at once, by all numbers of rays that may be asked for.
        """
        rim_pixels = np.flatnonzero(self.rim & self.view.sees_background.reshape(-1))
        missing = sorted({*_NUMBERS, *map(int, np.unique(across))} - self._known.keys())
        if missing:
            numbers = np.repeat(np.array(missing)[:, None], len(rim_pixels), axis=1)
            boundary = np.moveaxis(self.view.boundary_shares(rim_pixels, numbers), 1, 0)
            self._known.update(zip(missing, boundary, strict=True))
        place, out = np.searchsorted(rim_pixels, pixels), np.empty((0, len(pixels)))
        for number in np.unique(across):
            same_rays, shares = across == number, self._known[int(number)]
            out = out if len(out) else np.empty((len(shares), len(pixels)))
            out[:, same_rays] = shares[:, place[same_rays]]
        return out

    def __call__(self, weights: Reals, pixels: Ints, across: Ints) -> Floats:
        """Results (2, I, N) of `pixels` (N,) with weights (I, C, N) by `across`^2 rays; NaN: none.

        I is the number of images.
        """
        means = np.array(weights, np.float64)
        on_background = self.view.on_background(pixels)
        at = np.flatnonzero(on_background & self.rim[pixels])
        if len(at):
            shares = self._shares(pixels[at], across[at])
            for mean in means:
                mean[:, at] = evaluated(mean[:, at], shares, shares)
            on_background[at] = shares[0] > VISIBLE_DISC  # DIT fits pixels of at least this share
        return np.stack([self._of(mean, on_background) for mean in means], axis=1)

    def _of(self, weights: Reals, on_background: Mask) -> Floats:
        """Results (2, N) of weights (C, N) as DIT evaluates them; NaN where not `on_background`."""
        emissivity = 1.0 - weights[0]
        warm = on_background & (emissivity > self.view.visible)
        out = np.full((2, len(on_background)), np.nan)
        out[0, warm] = self.temperature.temperature_K(weights[:, warm])
        out[1, on_background] = self.temperature.per_emissivity_K * emissivity[on_background]
        return out

    def of_shares(self, weights: Reals, pixels: Ints, rays_across: Ints) -> Floats:
        """Change (2, N) if rim pixels saw the boundary by `SHARES` rays across; else 0.

        `weights` (C, N) are by `rays_across` rays across, and stand for the same medium.
        """
        out = np.zeros((2, len(pixels)))
        at = np.flatnonzero(self.view.on_background(pixels) & self.rim[pixels])
        if len(at):
            traced_shares, fine_shares = (
                self._shares(pixels[at], numbers)
                for numbers in (rays_across[at], np.full(len(at), SHARES))
            )
            on_background = np.minimum(traced_shares[0], fine_shares[0]) > VISIBLE_DISC
            traced, fine = (
                self._of(evaluated(weights[:, at], traced_shares, numbers), on_background)
                for numbers in (traced_shares, fine_shares)
            )
            out[:, at] = np.nan_to_num(fine - traced)
        return out


def evaluated(mean: Reals, seen: Floats, shares: Floats) -> Floats:
    """Weights (C, N) as DIT evaluates them, of pixels that see only a share of the background.

    `mean` (C, N) are the weights of rays of which the shares `seen` (B, N) end on each part of the
    boundary; `shares` (B, N) are those of the wanted rays, through the same medium. A pixel at the
    rim sees a share f of the background, and the wall beside it. DIT divides the excess over its
    reference by f: I(T_app) = (I - (1 - f) I_wall) / f for a medium of radiance I.
    """
    out = as_shared(mean, seen, shares)
    out[1 : len(shares)] -= shares[1:]  # their light without the spray
    return np.asarray(out / np.maximum(shares[0], VISIBLE_DISC))


def as_shared(mean: Reals, seen: Floats, shares: Floats) -> Floats:
    """Weights (C, N) through the same medium of rays of which other `shares` end on each part.

    Arguments as of `evaluated`; `seen` has at least half of the background where it matters.
    """
    out = np.array(mean, np.float64)
    through = out[0] / np.maximum(seen[0], _LEAST_SEEN)
    out[1 : len(shares)] += (shares[1:] - seen[1:]) * through  # transmitted light
    out[0] = shares[0] * through
    return out


def contrast_K(temperature_K: Floats) -> Floats:
    """RMS difference (H, W) of each pixel of `temperature_K` (H, W) from its four neighbours.

    Neighbours of NaN do not count; the result is 0 if none counts, and NaN where the pixel is NaN.
    """
    square, count = np.zeros(temperature_K.shape), np.zeros(temperature_K.shape)
    for axis in (0, 1):
        squares = np.diff(temperature_K, axis=axis) ** 2
        finite = np.isfinite(squares)
        for side in (slice(1, None), slice(None, -1)):
            at = (side, slice(None)) if axis == 0 else (slice(None), side)
            square[at] += np.where(finite, squares, 0.0)
            count[at] += finite
    return np.where(np.isfinite(temperature_K), np.sqrt(square / np.maximum(count, 1.0)), np.nan)


def contrasts(results: Floats) -> Floats:
    """`contrast_K` (2, H, W) of both results, of emissivity around pixels with a T_app alone."""
    near_visible = dilated(np.isfinite(results[0]), 1)
    emissivity = np.where(near_visible, contrast_K(results[1]), np.nan)
    return np.stack([contrast_K(results[0]), emissivity])


class RayChoice:
    """An image (images, C + 1, H W) whose pixels get more rays until both errors are small enough.

    across: (H W,) rays across each pixel. squares_K2: (2, H W) expected squares of the errors of
    each pixel's results, NaN in pixels without. count: pixels with a T_app.
    """

    def __init__(self, rays: Rays, images: Reals, results: PixelResults) -> None:
        """Takes the `images` by one ray, which are changed in place."""
        self.rays, self._images, self._results = rays, images, results
        count = images.shape[2]
        pixel_numbers, self.across = np.arange(count), np.ones(count, np.int64)
        self._kelvin = self._kelvin_of(images, pixel_numbers, self.across)
        self._shape = results.view.pixels[::-1]
        weights = images.mean(axis=0)[:-1]
        self._rim = results.of_shares(weights, pixel_numbers, self.across)
        # Squares of errors as by one ray, in pixels where they were measured.
        self._by_one, self._known = np.zeros((2, count)), np.zeros((2, count), bool)
        self._ratio, self._scale = np.full((2, 1), _FIRST), np.ones((2, 1))
        self._contrast = self._contrasts()

    @property
    def _seen(self) -> Mask:
        """(H W,) pixels with a T_app."""
        return np.asarray(np.isfinite(self._kelvin[0]).all(axis=0))

    @property
    def count(self) -> int:
        """See the class."""
        return int(np.count_nonzero(self._seen))

    def _contrasts(self) -> Floats:
        """(2, H W) differences from the neighbours; NaN where a pixel does not count."""
        mean_K = np.where(np.isfinite(self._kelvin).all(axis=1), self._kelvin.mean(axis=1), np.nan)
        return contrasts(mean_K.reshape(2, *self._shape)).reshape(2, -1)

    def _around(self, values: Floats) -> Floats:
        """Means (2, H W) over a pixel and its neighbours."""
        means = scipy.ndimage.uniform_filter(values.reshape(2, *self._shape), (1, 3, 3))
        return np.asarray(means.reshape(2, -1))

    @property
    def squares_K2(self) -> Floats:
        """See the class."""
        local_mean, share = self._around(self._by_one), self._around(self._known.astype(float))
        by_contrast = np.maximum((self._ratio * self._contrast) ** 2, local_mean) + self._rim**2
        local = local_mean / np.maximum(share, 1 / 9)
        by_measurement = np.maximum(np.maximum(self._by_one, local), 0.0)
        square = (
            np.where(self._known, by_measurement, by_contrast)
            * self._scale
            / self.across ** (2 * _ORDER)
        )
        return np.where(np.isfinite(self._contrast), square, np.nan)

    def grow(self, pixels: Ints, across: Ints) -> None:
        """Traces `pixels` (N,) by `across`^2 (N,) rays, and measures the change of the results."""
        weights = self.rays.through(pixels, across)
        kelvin = self._kelvin_of(weights, pixels, across)
        self._learn(pixels, kelvin - self._kelvin[:, :, pixels])
        self._kelvin[:, :, pixels] = kelvin
        self.across[pixels], self._images[:, :, pixels] = across, weights

    def _learn(self, pixels: Ints, changes_K: Floats) -> None:
        """Takes the errors of the present rays from changes (2, images, N) by more; NaN: none."""
        square = changes_K[:, 0] * changes_K[:, -1]  # without the noise of either, on average
        result, at = np.nonzero(np.isfinite(changes_K).all(axis=1))
        traced = pixels[at]
        self._by_one[result, traced] = square[result, at] * self.across[traced] ** (2 * _ORDER)
        self._known[result, traced] = True

    def change_K(self, weights: Reals, pixels: Ints, across: Ints) -> Floats:
        """Change (2, images, N) of results by `weights` (images, C + 1, N); NaN: unknown."""
        return np.asarray(self._kelvin_of(weights, pixels, across) - self._kelvin[:, :, pixels])

    def _kelvin_of(self, weights: Reals, pixels: Ints, across: Ints) -> Floats:
        return self._results(weights[:, :-1], pixels, across)

    def _widen(self) -> None:
        """Traces four rays in the pixels beside those with a T_app, which may see the medium."""
        box, view = self.rays.solution.cells.box(), self.rays.solution.view
        blur = view.blur_pixels(box.low[1], box.low[1] + box.shape[1])
        near_visible = dilated(self._seen.reshape(self._shape), 1 + blur).ravel()
        beside = np.flatnonzero(near_visible & ~self._seen & (self.across == 1))
        if len(beside):
            self.grow(beside, np.full(len(beside), 2))
            self._contrast = self._contrasts()

    def reach(self, error_K: float) -> bool:
        """Adds rays until the expected RMS errors are `error_K`; False if none can be added."""
        added = False
        for _ in range(_ROUNDS):
            square, allowed_square = np.nan_to_num(self.squares_K2), self.count * error_K**2
            if np.all(square.sum(axis=1) <= allowed_square):
                break
            needed = np.max(
                [allocated(row, self.across, allowed=_SAFE * allowed_square) for row in square],
                axis=0,
            )
            candidates = np.flatnonzero(needed > self.across)
            if not len(candidates) or not self.rays.affords(
                int(np.sum(4 * self.across[candidates] ** 2))
            ):
                break
            self._widen()
            candidates = candidates[self.across[candidates] < needed[candidates]]
            if len(candidates):  # else all of them were widened
                self.grow(candidates, 2 * self.across[candidates])
            added = True
        return added

    def correct(self, errors_K: Floats, pixels: Ints, changes_K: Floats) -> None:
        """Takes measured RMS errors (2,), and changes (2, images, N) in some pixels (N,)."""
        square = errors_K[:, None] ** 2 * max(self.count, 1)
        if np.all(self.across == 1):
            beyond = square - np.sum(self._rim**2, axis=1, keepdims=True)
            contrast = np.nansum(self._contrast**2, axis=1, keepdims=True)
            ratio = beyond / np.maximum(contrast, 1e-30)
            self._ratio = np.clip(ratio, _LEAST**2, _LARGEST**2) ** 0.5
        self._learn(pixels, changes_K)
        expected = np.nansum(self.squares_K2, axis=1, keepdims=True)
        self._scale *= np.clip(square / np.maximum(expected, 1e-30), 1.0, _MOST_SCALE)


def allocated(square: Floats, across: Ints, *, allowed: float) -> Ints:
    """Rays across each pixel (N,), a power of two, for a sum of squares at the fewest cost.

    Args:
        square: (N,) expected squares by the present rays.
        across: (N,) the present rays across, the fewest that a pixel gets.
        allowed: sum of squares; not reached where it takes too many rays.
    """
    by_one = square * across ** (2.0 * _ORDER)
    contributing = np.flatnonzero(by_one > 0)
    power = np.log2(by_one[contributing]) / (2.0 * (1.0 + _ORDER))
    fewest = across[contributing]

    def at(level: float) -> Ints:
        ideal = np.exp2(np.ceil(np.clip(power + level, 0.0, np.log2(MOST_ACROSS))))
        return np.maximum(ideal.astype(np.int64), fewest)

    rest, ray_limit = len(square) - len(contributing), _MOST_RAYS[0] * len(square) + _MOST_RAYS[1]
    low, high = -60.0, 60.0
    enough: Ints | None = None
    for _ in range(40):
        middle = (low + high) / 2
        numbers = at(middle)
        if np.sum(numbers**2) + rest > ray_limit:
            high = middle
        elif np.sum(by_one[contributing] / numbers ** (2.0 * _ORDER)) <= allowed:
            high, enough = middle, numbers
        else:
            low = middle
    out = across.copy()
    out[contributing] = at(low) if enough is None else enough
    return out
