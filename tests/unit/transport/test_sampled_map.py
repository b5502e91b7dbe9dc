"""Maps of errors that a sample of pixels measures, against errors of known size."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.transport.monte_carlo.pixel_sampling import PixelSample, sampled_square

COUNT = 60
ACROSS, DOWN = np.meshgrid(*[np.linspace(0.0, 1.0, COUNT)] * 2)
EDGES = np.abs(np.sin(40 * ACROSS) * np.sin(31 * DOWN)) ** 8  # few pixels have most of it


@pytest.mark.parametrize("size_K", [1.0 + 9.0 * ACROSS, 0.2 + 8.0 * EDGES], ids=["place", "edges"])
@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("share", [0.1, 0.9])  # of pixels: of a large image, and of a small one
def test_few_pixels_are_beyond_three_standard_errors(
    size_K: np.ndarray, noise: float, share: float
) -> None:
    """Errors are normal, of which 0.3 % are beyond; sixteen squares know their mean to a third.
    As in `error_maps` the map has the RMS of the error."""
    rng = np.random.default_rng(4)
    counted = (ACROSS - 0.5) ** 2 + (DOWN - 0.5) ** 2 < 0.2
    error_K = size_K * rng.standard_normal((COUNT, COUNT))
    importance = np.where(counted, size_K**2 + 0.1 * np.mean(size_K**2), 0.0)
    sample = PixelSample.of(importance.ravel(), size=round(share * counted.sum()), seed=1)
    true = error_K.ravel()[sample.pixels]
    one, other = (
        true + sign * noise * size_K.ravel()[sample.pixels] * rng.standard_normal(len(true))
        for sign in (1, -1)
    )
    features = size_K * rng.uniform(0.8, 1.25, (COUNT, COUNT)), rng.random((COUNT, COUNT))
    square = sampled_square(sample, one * other, features, counted)
    assert np.isnan(square[~counted]).all() and np.isfinite(square[counted]).all()
    more = np.mean(square[counted]) / np.mean(error_K[counted] ** 2)
    assert 0.8 < more  # a standard error is added, and large errors are drawn more often
    beyond = np.abs(error_K[counted]) > 3.0 * np.sqrt(square[counted] / more)
    assert beyond.mean() < 0.02
    even = np.abs(error_K[counted]) > 3.0 * np.sqrt(np.mean(error_K[counted] ** 2))
    assert even.mean() > beyond.mean()


def test_a_bias_is_where_it_was_measured() -> None:
    """Of 18 K in a corner, and none elsewhere, which both halves of an image share."""
    corner = (ACROSS > 0.6) & (DOWN > 0.6)
    counted = np.ones((COUNT, COUNT), bool)
    sample = PixelSample.of(np.ones(COUNT**2), size=400, seed=2)
    measured = np.where(corner, -18.0, 0.0).ravel()[sample.pixels]
    square = sampled_square(sample, measured**2, (corner.astype(float),), counted)
    assert np.all(18.0 < 3.0 * np.sqrt(square[corner]))
    assert np.mean(square[~corner]) < 0.05 * 18.0**2


def test_no_pixel_of_the_sample_counts() -> None:
    counted = np.zeros((4, 4), bool)
    counted[0] = True
    sample = PixelSample(np.array([9, 10]), np.ones(2))
    assert np.isnan(sampled_square(sample, np.ones(2), (), counted)).all()
