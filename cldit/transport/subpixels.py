"""Sampling error within pixels, measured by tracing a few pixels with many more rays.

The light of a pixel is the mean over its area. The error of the image's rays is measured in a
sample of pixels, with the same sources; nothing is extrapolated. The variation within a pixel is
about as large as its difference from the neighbours. So pixels are drawn with probabilities in
proportion to the square of that difference, which minimises the variance of the errors' sum of
squares. A part of the probability is uniform, since structures smaller than a pixel show in none.
No ray of the sample influences the draw, so there is no bias.

A pixel at the rim of the background sees a share f of it, and the wall beside it. DIT divides the
excess over its reference by f: I(T_app) = (I - (1 - f) I_wall) / f for a medium of radiance I. A
ray through the middle has f = 1, other rays another f: the resulting change of T_app is known
without tracing them, and also enters the probabilities.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from cldit.optics.visible import VISIBLE_DISC, VISIBLE_EMISSIVITY
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.image import RAYS_ACROSS
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.result import Subpixels, TraceSettings, weights_of
from cldit.transport.tuning import Tuning
from cldit.transport.view import View

Floats = NDArray[np.float64]

# Ratio of rays across a pixel: the error is a 16th of the image's where light is smooth, and an 8th
# at edges, whose square adds a 64th.
_MORE = 4


def sampled_subpixels(
    image: NDArray[np.floating],
    several: Callable[[NDArray[np.int64], int], NDArray[np.floating]],
    cells: OpticalCells,
    scene: Scene,
    view: View,
    settings: TraceSettings,
) -> Subpixels | None:
    """Draws pixels of an image and traces them by more rays; None if no pixel has a T_app.

    Args:
        image: (C + 1, H, W) weights, the part from within the medium last.
        several: maps pixels (N,) and rays across each to weights (1 or 2, C + 1, N) by each half
            of the ordinates.
        cells, scene, view, settings: of the trace.
    """
    parts, rows, columns = image.shape
    flat = image.reshape(parts, -1)
    seen = view.has_temperature(1.0 - flat[0], np.arange(flat.shape[1]))
    apparent_K = np.full(flat.shape[1], np.nan)
    if not seen.any():
        return None
    temperature = cells.temperature(scene)
    apparent_K[seen] = temperature.temperature_K(flat[:-1, seen])
    few = RAYS_ACROSS[scene.camera.rays_per_pixel]
    across = _MORE * few
    rim = np.zeros(flat.shape[1])
    at = np.flatnonzero(seen & ~minimum_filter(view.sees_background, 3).reshape(-1))
    if len(at):
        seen_by = [view.boundary_shares(at, each) for each in (few, across)]
        as_seen = [_evaluated(flat[:-1, at], seen_by[0], each) for each in seen_by]
        there = 1.0 - as_seen[0][0] > VISIBLE_EMISSIVITY  # the wall's share is no emissivity
        # DIT fits pixels of at least this share.
        there &= np.minimum(*(each[0] for each in seen_by)) > VISIBLE_DISC
        here_K, more_K = (temperature.temperature_K(one[:, there]) for one in as_seen)
        rim[at[there]] = more_K - here_K
    sample = drawn(
        apparent_K.reshape(rows, columns), rim, tuning=settings.tuning, seed=settings.seed
    )
    halves = several(sample.pixels, across)[:, :, None, :]
    difference = None if len(halves) < 2 else weights_of((halves[0] - halves[1]) / 2, cells)
    shares = [view.boundary_shares(sample.pixels, each) for each in (few, across)]
    references = None
    if any(np.any(each[0] < 1.0) for each in shares):
        one, other = (_boundary(each, cells) for each in shares)
        references = one, other
    mean = weights_of(halves.mean(axis=0), cells)
    return Subpixels(sample, across, mean, difference, references)


def _evaluated(mean: NDArray[np.floating], seen: Floats, shares: Floats) -> Floats:
    """Weights (C, N) as DIT evaluates them, of pixels that see only a share of the background.

    `mean` (C, N) are the weights of rays of which the shares `seen` (B, N) end on each part of the
    boundary; `shares` (B, N) are those of the wanted rays, through the same medium.
    """
    through = mean[0] / np.maximum(seen[0], VISIBLE_DISC)
    out = np.array(mean, np.float64)
    # Transmitted light of the other parts, less their light without the spray.
    out[1 : len(shares)] += (shares[1:] - seen[1:]) * through - shares[1:]
    out /= np.maximum(shares[0], VISIBLE_DISC)
    out[0] = through
    return out


def _boundary(shares: Floats, cells: OpticalCells) -> Weights:
    """Weights (1, N) without a medium."""
    planes = np.zeros((len(cells.needs.components), 1, shares.shape[1]))
    planes[: len(shares), 0] = shares
    return weights_of(planes, cells)


def drawn(
    temperature_K: Floats, rim_K: Floats | float = 0.0, *, tuning: Tuning, seed: int
) -> PixelSample:
    """Sample of the pixels that have a temperature, most of them at high contrast.

    Args:
        temperature_K: (H, W), NaN where there is none, but not everywhere.
        rim_K: (H W,) known error of pixels at the rim of the background.
        tuning: number of pixels, and the uniform share of the probability.
        seed: of the random start.
    """
    square = contrast_K(temperature_K).reshape(-1) ** 2 + np.square(rim_K)
    known = np.isfinite(square)
    even = tuning.audit_even * float(square[known].mean()) or 1.0  # of a uniform image
    importance = np.where(known, square + even, 0.0)
    return PixelSample.of(importance, most=tuning.subpixels, seed=seed)


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
