"""Allocation of rays to pixels, and pixels drawn with chances of their own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cldit.transport.final_gather.gather import Gather
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.ray_choice import MOST_ACROSS, allocated, as_shared, contrasts, evaluated
from cldit.transport.sobol import net
from cldit.transport.subpixels import important
from cldit.transport.tuning import Tuning

ONE = np.ones(1000, np.int64)


def left(square: np.ndarray, across: np.ndarray) -> float:
    """Sum of squares by these rays, which falls with their number as n^-3/2."""
    return float(np.sum(square / across**3.0))


@pytest.mark.parametrize("allowed", [1e-2, 0.1, 0.5])
def test_sum_of_squares_at_little_cost(allowed: float) -> None:
    """Against the best allocation of any number of rays: rounding to powers of four costs no more
    than a factor of four."""
    square = np.random.default_rng(1).random(1000) ** 8
    square /= square.sum()
    across = allocated(square, ONE, allowed=allowed)
    assert left(square, across) <= allowed
    assert set(np.unique(across)) <= {1, 2, 4, 8, 16}
    assert np.all(np.diff(across[np.argsort(square)]) >= 0)
    many = square**0.4  # n in proportion to e^(4/5), so that the sum of squares is what is allowed
    many *= (np.sum(square / many**1.5) / allowed) ** (2 / 3)
    assert np.sum(across**2) <= 4 * np.sum(np.maximum(many, 1.0))


def test_what_pixels_have_is_kept() -> None:
    square = np.full(1000, 1e-3)
    have = np.where(np.arange(1000) < 100, 8, 1)
    across = allocated(square, have, allowed=0.5)
    assert np.all(across >= have) and left(square * have**3.0, across) <= 0.5
    assert np.array_equal(allocated(square, have, allowed=2.0), have)


@pytest.mark.parametrize("count", [1, 4, 16, 64, 256, 1024])
def test_rays_of_a_pixel_are_a_net(count: int) -> None:
    """One point in each row, in each column, and in each rectangle of the same area."""
    whole = net(count)
    points = whole[:, :2]
    for rows in 2 ** np.arange(int(np.log2(count)) + 1):
        place = np.floor(points * [rows, count // rows])
        assert len(np.unique(place, axis=0)) == count
    np.testing.assert_allclose(whole.mean(axis=0), 0.5)


def test_the_number_of_rays_has_an_end() -> None:
    square = np.ones(40_000)
    across = allocated(square, np.ones(len(square), np.int64), allowed=1e-9)
    assert across.max() <= MOST_ACROSS
    assert 0.2 < np.sum(across**2) / (4 * len(square) + 1e6) <= 1.0
    spread = np.geomspace(1.0, 1e6, len(square))
    across = allocated(spread, np.ones(len(square), np.int64), allowed=1e-9)
    assert 0.8 < np.sum(across**2) / (4 * len(square) + 1e6) <= 1.0
    nothing = allocated(np.zeros(5), np.ones(5, np.int64), allowed=0.0)
    assert np.all(nothing == 1)


def test_few_rays_stand_for_the_exact_share_of_the_background() -> None:
    """A uniform medium transmits 0.3: weights by any rays give those by the exact shares."""
    seen, exact = np.array([[0.625], [0.375]]), np.array([[0.579], [0.421]])
    few, true = (np.concatenate([0.3 * shares, [[0.5]]]) for shares in (seen, exact))
    assert as_shared(few, seen, exact) == pytest.approx(true)
    # DIT subtracts the wall's light without the spray, and divides by the background's share.
    wanted = [0.3, (0.3 - 1.0) * 0.421 / 0.579, 0.5 / 0.579]
    assert evaluated(few, seen, exact)[:, 0] == pytest.approx(wanted)


def test_rays_through_thick_cells_share_the_paths_of_an_image() -> None:
    """A thousand rays took half of the scatterings that an image may have."""
    gather = object.__new__(Gather)
    gather._settings = cast(Any, SimpleNamespace(tuning=Tuning(path_segments=1e6)))
    gather._spent, gather._rays, gather.short = 5e5, 1000, ""
    assert gather.affords(1000) and not gather.short
    assert not gather.affords(1001) and "1e+06 scatterings" in gather.short


MANY = 400
EDGE = 60  # of an image, in pixels


@pytest.fixture
def importance() -> np.ndarray:
    """Of 3000 pixels, over three decades; every third is of none."""
    values = np.random.default_rng(1).lognormal(0.0, 1.7, 3000)
    values[::3] = 0.0
    return values


def test_unbiased_and_knows_its_error(importance: np.ndarray) -> None:
    """Values that follow their importance but loosely, and a few that do not at all.

    400 draws: the mean is good to a 20th of one draw's error, four of which are allowed, and the
    scatter of draws to 4 %. Even steps beat independent draws at most by what neighbours have in
    common, here nothing.
    """
    rng = np.random.default_rng(2)
    here = importance > 0
    values = np.where(here, importance * rng.gamma(2.0, 1.0, 3000), 0.0)
    values[np.flatnonzero(here)[::50]] += 1.0
    noise = 0.3 * importance
    totals, errors = [], []
    for seed in range(MANY):
        drawn = PixelSample.of(importance, size=200, seed=seed)
        # The seeds of what is drawn and of its noise are apart, as in the audit.
        noisy = values + noise * np.random.default_rng(10_000 + seed).standard_normal(3000)
        total, error = drawn.total(noisy[drawn.pixels], noise[drawn.pixels] ** 2)
        totals.append(total)
        errors.append(error)
    scatter = float(np.std(totals, ddof=1))
    assert abs(np.mean(totals) - values.sum()) < 4 * scatter / MANY**0.5
    assert scatter < 0.1 * values.sum()
    assert float(np.mean(np.square(errors))) ** 0.5 == pytest.approx(scatter, rel=0.15)


def test_chances_are_kept(importance: np.ndarray) -> None:
    """Frequency with which a pixel is drawn: binomial, five deviations of the worst of 2000."""
    often = np.zeros(3000)
    chance = np.zeros(3000)
    for seed in range(MANY):
        drawn = PixelSample.of(importance, size=200, seed=seed)
        assert abs(len(drawn.pixels) - 200) <= 1
        often[drawn.pixels] += 1
        chance[drawn.pixels] = drawn.chance
    known = chance > 0
    allowed = 5 * np.sqrt(MANY * chance * (1 - chance)) + 2
    assert np.all(np.abs(often - MANY * chance)[known] <= allowed[known])
    assert often[importance == 0].sum() == 0
    sure = importance >= np.sort(importance)[-10]
    assert chance[sure].min() == 1.0 and np.all(often[sure] == MANY)
    # In proportion below 1: the ratio is one number.
    free = known & (chance < 1.0)
    ratio = chance[free] / importance[free]
    np.testing.assert_allclose(ratio, ratio[0])


@pytest.mark.parametrize("count", [0, 1, 7, 200])
def test_few_are_all_drawn(count: int) -> None:
    """The sum is then exact but for the noise, and so is its error."""
    importance = np.concatenate([np.zeros(5), np.geomspace(1e-9, 1e9, count)])
    drawn = PixelSample.of(importance, size=200, seed=3)
    np.testing.assert_array_equal(drawn.pixels, np.arange(5, 5 + count))
    assert np.all(drawn.chance == 1.0)
    total, error = drawn.total(np.arange(count, dtype=float), np.full(count, 4.0))
    assert total == pytest.approx(count * (count - 1) / 2)
    assert error == pytest.approx(2 * count**0.5)


def test_one_pixel_far_above_all_others() -> None:
    """It is drawn for sure; the others share what is left evenly."""
    importance = np.ones(1000)
    importance[400] = 1e12
    drawn = PixelSample.of(importance, size=11, seed=4)
    assert drawn.chance[drawn.pixels == 400] == 1.0
    others = drawn.chance[drawn.pixels != 400]
    assert len(others) == 10
    np.testing.assert_allclose(others, 10 / 999)
    # All alike: nothing is missed by not drawing them.
    total, error = drawn.total(importance[drawn.pixels], np.zeros(11))
    assert total == pytest.approx(importance.sum())
    assert error == pytest.approx(0.0, abs=1e-9)


def test_what_noise_makes_of_the_doubt(importance: np.ndarray) -> None:
    """New noise in the same pixels: the mean square varies by the share that is told to be noise's.

    A variance of 1000 draws is good to (2 / 1000)^(1/2), four of which are allowed.
    """
    draws, rng = 1000, np.random.default_rng(5)
    drawn = PixelSample.of(importance, size=200, seed=6)
    error = np.sqrt(importance[drawn.pixels]) * rng.gamma(2.0, 1.0, len(drawn.pixels))
    squares, told = [], []
    for _ in range(draws):
        one, other = error + 0.5 * error * rng.standard_normal((2, len(error)))
        square, doubt = drawn.mean_square(one, other, count=2000)
        squares.append(square)
        told.append(drawn.by_noise(one, other) * doubt**2)
    assert np.mean(told) == pytest.approx(np.var(squares, ddof=1), rel=4 * (2 / draws) ** 0.5)
    assert drawn.by_noise(error, error) == 0.0  # all of it is by the choice of pixels
    every = PixelSample(drawn.pixels, np.ones(len(error)))
    assert every.by_noise(error, 1.1 * error) == pytest.approx(1.0)  # none of it
    assert every.by_noise(error, error) == 0.0


def test_pixels_at_edges_are_drawn() -> None:
    """Of an edge through even light, all pixels beside it are of the sample, and few others."""
    kelvin = np.full((2, EDGE, EDGE), 300.0)
    kelvin[0, :, 20:] = 310.0
    kelvin[1, :, 40:] = 310.0  # emissivity has its edge elsewhere
    kelvin[:, 0] = np.nan
    contrast = contrasts(kelvin)
    beside = np.any(contrast > 0, axis=0)
    assert np.count_nonzero(beside) == 4 * (EDGE - 1)
    sample = important(contrast.reshape(2, -1) ** 2, tuning=Tuning(subpixels=300), seed=1)
    assert set(np.flatnonzero(beside)) <= set(sample.pixels)
    assert not set(range(EDGE)) & set(sample.pixels)
    assert len(sample.pixels) == pytest.approx(300, abs=1)
