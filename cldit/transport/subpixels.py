"""Sampling error within pixels, measured by tracing a few pixels with many more rays.

The light of a pixel is the mean over its area. The error of the image's rays is measured in a
sample of pixels, with the same sources; nothing is extrapolated. The variation within a pixel is
about as large as its difference from the neighbours. So pixels are drawn with probabilities in
proportion to the square of that difference, which minimises the variance of the errors' sum of
squares. A part of the probability is uniform, since structures smaller than a pixel show in none.
No ray of the sample influences the draw, so there is no bias.

A ray through the middle of a pixel at the rim of the background sees all of it or nothing, other
rays a share: the resulting change of T_app is known without tracing them, and also enters the
probabilities. Where rays were chosen for each pixel (ray_choice.py), the expected squares of the
errors are the probabilities.
"""

import numpy as np

from cldit.arrays import Floats, Ints, Reals
from cldit.optics.visible import VISIBLE_DISC
from cldit.radiance.weights import Weights
from cldit.transport.cells import OpticalCells
from cldit.transport.image import Rays
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.ray_choice import (
    SHARES,
    PixelResults,
    RayChoice,
    as_shared,
    contrasts,
)
from cldit.transport.result import Subpixels, TraceSettings, weights_of
from cldit.transport.tuning import Tuning

# Ratio of rays across a pixel: the error is a 16th of the image's where light is smooth, and an 8th
# at edges, whose square adds a 64th. Twice the rays of a pixel that has many adds an 8th.
_MORE, _TWICE = 4, 2


def sampled_subpixels(
    rays: Rays,
    image: Reals,
    across: Ints,
    results: PixelResults,
    settings: TraceSettings,
) -> Subpixels | None:
    """Draws pixels of an image and traces them by more rays; None if no pixel has a T_app.

    Args:
        rays: trace more of them.
        image: (C + 1, H, W) weights, the part from within the medium last.
        across: (H W,) the image's rays across each pixel.
    """
    flat = image.reshape(len(image), -1)
    pixel_numbers = np.arange(flat.shape[1])
    traced = results(flat[None, :-1], pixel_numbers, across)[:, 0]
    if not np.isfinite(traced[0]).any():
        return None
    rim = results.of_shares(flat[:-1], pixel_numbers, across)
    contrast = contrasts(traced.reshape(2, *image.shape[1:])).reshape(2, -1)
    square = contrast**2 + np.square(rim)
    sample = important(square, tuning=settings.tuning, seed=settings.seed)
    return many_rays(rays, sample, across, _MORE * across[sample.pixels])[0]


def measured_subpixels(
    choice: RayChoice, settings: TraceSettings, number: int
) -> tuple[Subpixels | None, float]:
    """The same for rays that were chosen, and the larger RMS error that the sample measures.

    The pixels of each `number` of sample are drawn anew. `choice` takes what they show.
    """
    if not choice.count:
        return None, 0.0
    sample = important(choice.squares_K2, tuning=settings.tuning, seed=settings.seed + number)
    rays_across = choice.across[sample.pixels]
    more_across = np.where(rays_across <= _TWICE, _MORE, _TWICE) * rays_across
    traced, halves = many_rays(choice.rays, sample, choice.across, more_across)
    change = choice.change_K(halves, sample.pixels, np.full(len(more_across), SHARES))
    moments = [
        sample.mean_square(planes_of_half[0], planes_of_half[-1], count=choice.count)
        for planes_of_half in np.nan_to_num(change)
    ]
    errors_K = np.array([max(square, 0.0) + doubt for square, doubt in moments]) ** 0.5
    choice.correct(errors_K, sample.pixels, change)
    return traced, float(errors_K.max())


def many_rays(
    rays: Rays, sample: PixelSample, across: Ints, more_across: Ints
) -> tuple[Subpixels, Reals]:
    """Pixels of a sample (N,) by `more_across` (N,) rays across each, and their halves' weights.

    The rays sample the medium; how much of the boundary a pixel sees is exact. `across` (H W,) are
    the image's rays across each pixel.
    """
    cells, view = rays.solution.cells, rays.solution.view
    planes = rays.through(sample.pixels, more_across)
    numbers = np.stack([across[sample.pixels], more_across, np.full(len(more_across), SHARES)])
    image_shares, seen, shares = np.moveaxis(view.boundary_shares(sample.pixels, numbers), 1, 0)
    rim = (shares[0] < 1.0) & (shares[0] > VISIBLE_DISC)
    for planes_of_half in planes:
        planes_of_half[:-1, rim] = as_shared(planes_of_half[:-1, rim], seen[:, rim], shares[:, rim])
    halves = planes[:, :, None, :]
    difference = None if len(halves) < 2 else weights_of((halves[0] - halves[1]) / 2, cells)
    references = None
    if np.any(image_shares[0] < 1.0) or np.any(shares[0] < 1.0):
        references = _boundary(image_shares, cells), _boundary(shares, cells)
    mean = weights_of(halves.mean(axis=0), cells)
    return Subpixels(sample, more_across, mean, difference, references), planes


def _boundary(shares: Floats, cells: OpticalCells) -> Weights:
    """Weights (1, N) without a medium."""
    planes = np.zeros((len(cells.needs.components), 1, shares.shape[1]))
    planes[: len(shares), 0] = shares
    return weights_of(planes, cells)


def important(squares: Floats, *, tuning: Tuning, seed: int) -> PixelSample:
    """Sample by expected squares (2, H W) of both results, NaN in pixels that do not count.

    The pixels of either have half of the probability, a part of it uniform.
    """
    importance = np.zeros(squares.shape[1])
    for square in squares:
        finite = np.isfinite(square)
        total = float(square[finite].sum())
        even = tuning.audit_even * total / finite.sum() if total > 0.0 else 1.0  # a uniform image
        share = np.where(finite, square + even, 0.0)
        importance += share / share.sum()
    return PixelSample.of(importance, size=tuning.subpixels, seed=seed)
