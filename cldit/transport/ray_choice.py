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

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

from cldit.arrays import Floats, Ints, Mask, Reals
from cldit.optics.visible import VISIBLE_DISC
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.transport.image import Rays, by_number
from cldit.transport.view import View

Counts = Ints

MOST_ACROSS = 16
SHARES = 32  # rays across, without a medium, by which the share of the background is exact
_MOST_RAYS = 4, 1_000_000  # on average over the image, and beside that: a second or two
_FIRST = 0.2  # error by one ray over the difference from the neighbours, before it is measured
_LEAST, _LARGEST = 0.02, 1.0  # of that ratio, measured
_ORDER = 1.5  # of the square in the number of rays
_SAFE = 0.7  # of the allowed square, which the expected square aims at
_LEAST_SEEN = 0.25  # share of the background, by few rays, where exactly it is more than half
_MOST_SCALE = 4.0  # of the expected squares by one measurement, which has noise
_ROUNDS = 10


@dataclass(frozen=True)
class PixelTemperature:
    """T_app of pixels as DIT evaluates it: rim pixels by their excess over the reference.

    rim: (H W,) pixels with other than the background around them.
    """

    view: View
    temperature: TraceTemperature
    rim: Mask

    @classmethod
    def of(cls, view: View, temperature: TraceTemperature) -> "PixelTemperature":
        """Finds the pixels at the rim of the background."""
        rim = ~minimum_filter(view.sees_background, 3 + 2 * view.edge_pixels)
        return cls(view, temperature, rim.reshape(-1))

    def __call__(self, weights: Reals, pixels: Counts, across: Counts) -> Floats:
        """T_app (N,) of `pixels` (N,) with `weights` (C, N) by `across`^2 rays; NaN: none."""
        mean = np.array(weights, np.float64)
        there = self.view.has_temperature(1.0 - mean[0], pixels)
        at = np.flatnonzero(there & self.rim[pixels])
        if len(at):
            shares = by_number(self.view.boundary_shares, pixels[at], across[at])
            mean[:, at] = evaluated(mean[:, at], shares, shares)
            # The wall's share is no emissivity, and DIT fits pixels of at least this share.
            there[at] = (1.0 - mean[0, at] > self.view.visible) & (shares[0] > VISIBLE_DISC)
        out = np.full(len(pixels), np.nan)
        out[there] = self.temperature.temperature_K(mean[:, there])
        return out

    def of_shares(self, weights: Reals, pixels: Counts, few: Counts) -> Floats:
        """Change of T_app (N,) if rim pixels saw the boundary by `SHARES` rays across; else 0.

        `weights` (C, N) are by `few` rays across, and stand for the same medium.
        """
        out = np.zeros(len(pixels))
        seen = self.view.has_temperature(1.0 - weights[0], pixels)
        at = np.flatnonzero(seen & self.rim[pixels])
        if len(at):
            one, other = (
                by_number(self.view.boundary_shares, pixels[at], each)
                for each in (few[at], np.full(len(at), SHARES))
            )
            as_seen = [evaluated(weights[:, at], one, each) for each in (one, other)]
            there = 1.0 - as_seen[0][0] > self.view.visible
            there &= np.minimum(one[0], other[0]) > VISIBLE_DISC
            here_K, more_K = (self.temperature.temperature_K(each[:, there]) for each in as_seen)
            out[at[there]] = more_K - here_K
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
        apart = np.diff(temperature_K, axis=axis) ** 2
        known = np.isfinite(apart)
        for side in (slice(1, None), slice(None, -1)):
            here = (side, slice(None)) if axis == 0 else (slice(None), side)
            square[here] += np.where(known, apart, 0.0)
            count[here] += known
    return np.where(np.isfinite(temperature_K), np.sqrt(square / np.maximum(count, 1.0)), np.nan)


class RayChoice:
    """An image (images, C + 1, H W) whose pixels get more rays until their error is small enough.

    across: (H W,) rays across each pixel. square_K2: (H W,) expected square of each pixel's error,
    NaN in pixels without a T_app.
    """

    def __init__(self, rays: Rays, images: Reals, temperature: PixelTemperature) -> None:
        """Takes the `images` by one ray, which are changed in place."""
        self.rays, self._images, self._temperature = rays, images, temperature
        count = images.shape[2]
        every, self.across = np.arange(count), np.ones(count, np.int64)
        self._kelvin = np.stack([temperature(each[:-1], every, self.across) for each in images])
        self._shape = temperature.view.pixels[::-1]
        weights = images.mean(axis=0)[:-1]
        self._rim = temperature.of_shares(weights, every, self.across)
        # Squares of errors as by one ray, in pixels where they were measured.
        self._by_one, self._known = np.zeros(count), np.zeros(count, bool)
        self._ratio, self._scale, self._contrast = _FIRST, 1.0, self._contrasts()

    @property
    def _seen(self) -> Mask:
        """(H W,) pixels with a T_app."""
        return np.asarray(np.isfinite(self._kelvin).all(axis=0))

    def _contrasts(self) -> Floats:
        """(H W,) differences from the neighbours; 0 where there is no T_app."""
        mean_K = np.where(self._seen, self._kelvin.mean(axis=0), np.nan)
        return np.nan_to_num(contrast_K(mean_K.reshape(self._shape)).reshape(-1))

    @property
    def square_K2(self) -> Floats:
        """See the class."""
        around = uniform_filter(self._by_one.reshape(self._shape), 3).ravel()
        share = uniform_filter(self._known.astype(float).reshape(self._shape), 3).ravel()
        one = np.maximum((self._ratio * self._contrast) ** 2, around) + self._rim**2
        local = around / np.maximum(share, 1 / 9)
        many = np.maximum(np.maximum(self._by_one, local), 0.0)
        square = np.where(self._known, many, one) * self._scale / self.across ** (2 * _ORDER)
        return np.where(self._seen, square, np.nan)

    def grow(self, pixels: Counts, across: Counts) -> None:
        """Traces `pixels` (N,) by `across`^2 (N,) rays, and measures the change of T_app."""
        found = self.rays.through(pixels, across)
        kelvin = self._kelvin_of(found, pixels, across)
        apart = kelvin - self._kelvin[:, pixels]
        both = np.isfinite(apart).all(axis=0)
        self._learn(pixels[both], apart[:, both])
        self._kelvin[:, pixels] = kelvin
        self.across[pixels], self._images[:, :, pixels] = across, found

    def _learn(self, pixels: Counts, apart: Floats) -> None:
        """Takes the error of the present rays from changes (images, N) by more rays."""
        square = apart[0] * apart[-1]  # without the noise of either, on average
        self._by_one[pixels] = square * self.across[pixels] ** (2 * _ORDER)
        self._known[pixels] = True

    def change_K(self, found: Reals, pixels: Counts, across: Counts) -> Floats:
        """Change (images, N) of T_app by weights `found` (images, C + 1, N); 0 where unknown."""
        return np.asarray(
            np.nan_to_num(self._kelvin_of(found, pixels, across) - self._kelvin[:, pixels])
        )

    def _kelvin_of(self, found: Reals, pixels: Counts, across: Counts) -> Floats:
        return np.stack([self._temperature(each[:-1], pixels, across) for each in found])

    def _widen(self) -> None:
        """Traces four rays in the pixels beside those with a T_app, whose mean may have one."""
        box, view = self.rays.solution.cells.box(), self.rays.solution.view
        blur = view.blur_pixels(box.low[1], box.low[1] + box.shape[1])
        near = maximum_filter(self._seen.reshape(self._shape), 3 + 2 * blur).reshape(-1)
        beside = np.flatnonzero(near & ~self._seen & (self.across == 1))
        if len(beside):
            self.grow(beside, np.full(len(beside), 2))
            self._contrast = self._contrasts()

    def reach(self, error_K: float) -> bool:
        """Adds rays until the expected RMS error is `error_K`; False if none can be added."""
        added = False
        for _ in range(_ROUNDS):
            count = int(np.count_nonzero(self._seen))
            square = np.nan_to_num(self.square_K2)
            if square.sum() <= count * error_K**2:
                break
            wanted = allocated(square, self.across, allowed=_SAFE * count * error_K**2)
            more = np.flatnonzero(wanted > self.across)
            if not len(more) or not self.rays.affords(int(np.sum(4 * self.across[more] ** 2))):
                break
            if np.all(self.across == 1):
                self._widen()
            self.grow(more, 2 * self.across[more])
            added = True
        return added

    def correct(self, error_K: float, pixels: Counts, apart: Floats) -> None:
        """Takes a measured RMS error, and the changes (images, N) of T_app in some pixels (N,)."""
        count = max(int(np.count_nonzero(self._seen)), 1)
        if np.all(self.across == 1):
            beyond = error_K**2 * count - float(np.sum(self._rim**2))
            contrast = max(float(np.sum(self._contrast**2)), 1e-30)
            self._ratio = float(np.clip(beyond / contrast, _LEAST**2, _LARGEST**2) ** 0.5)
        self._learn(pixels, apart)
        expected = max(float(np.nansum(self.square_K2)) / count, 1e-30)
        self._scale *= float(np.clip(error_K**2 / expected, 1.0, _MOST_SCALE))


def allocated(square: Floats, across: Counts, *, allowed: float) -> Counts:
    """Rays across each pixel (N,), a power of two, for a sum of squares at the least cost.

    Args:
        square: (N,) expected squares by the present rays.
        across: (N,) the present rays across, the least that a pixel gets.
        allowed: sum of squares; not reached where it takes too many rays.
    """
    by_one = square * across ** (2.0 * _ORDER)
    some = np.flatnonzero(by_one > 0)
    power = np.log2(by_one[some]) / (2.0 * (1.0 + _ORDER))
    least = across[some]

    def at(level: float) -> Counts:
        ideal = np.exp2(np.ceil(np.clip(power + level, 0.0, np.log2(MOST_ACROSS))))
        return np.maximum(ideal.astype(np.int64), least)

    rest, most = len(square) - len(some), _MOST_RAYS[0] * len(square) + _MOST_RAYS[1]
    low, high = -60.0, 60.0
    enough: Counts | None = None
    for _ in range(40):
        middle = (low + high) / 2
        each = at(middle)
        if np.sum(each**2) + rest > most:
            high = middle
        elif np.sum(by_one[some] / each ** (2.0 * _ORDER)) <= allowed:
            high, enough = middle, each
        else:
            low = middle
    out = across.copy()
    out[some] = at(low) if enough is None else enough
    return out
