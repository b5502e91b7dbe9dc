"""Chi-square with shared modes and correlated neighbours, against drawn errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.stats import kstest

from cldit.camera.correlation import correlation
from cldit.comparison.chi_square import chi_square

SHAPE = (48, 60)
EVERYWHERE = np.ones(SHAPE, bool)
NONE = np.zeros((0, *SHAPE))


def smooth(rng: np.random.Generator, sigma: float) -> NDArray[np.float64]:
    """Noise of variance 1, correlated over `sigma` pixels."""
    if sigma == 0.0:
        return rng.standard_normal(SHAPE)
    wide = gaussian_filter(rng.standard_normal((96, 120)), sigma, mode="wrap")
    return np.asarray(wide[:48, :60] * 2.0 * np.sqrt(np.pi) * sigma)


def test_woodbury_is_the_dense_sum() -> None:
    rng = np.random.default_rng(1)
    error, modes = rng.uniform(0.5, 2.0, SHAPE), rng.standard_normal((3, *SHAPE))
    change = rng.standard_normal(SHAPE)
    where = rng.random(SHAPE) < 0.1
    found = chi_square(change, error, modes, where)
    assert found is not None
    u = modes[:, where]
    covariance = np.diag(error[where] ** 2) + u.T @ u
    dense = change[where] @ np.linalg.solve(covariance, change[where])
    # White noise: neighbours are correlated by chance alone, in few of the distances.
    assert found.reduced == pytest.approx(dense / where.sum(), rel=1e-3)
    fitted = u @ np.linalg.solve(covariance, change[where])
    assert found.sizes == pytest.approx(fitted, rel=0.01, abs=0.01 * where.sum() ** -0.5)


@pytest.mark.parametrize("sigma", [0.0, 1.0, 2.0])
def test_p_is_uniform(sigma: float) -> None:
    """Errors as stated, independent or correlated, with two modes: Kolmogorov and Smirnov."""
    rng = np.random.default_rng(2)
    error = 0.5 + np.hypot(*np.indices(SHAPE)) / 30.0
    modes = np.stack([1.0 + 0.0 * error, 2.0 * np.sin(np.arange(60) / 10.0) + 0.0 * error])
    chances, reduced = [], []
    for _ in range(150):
        change = error * smooth(rng, sigma) + np.einsum("m,mhw", rng.standard_normal(2), modes)
        found = chi_square(change, error, modes, EVERYWHERE)
        assert found is not None
        chances.append(found.p_value)
        reduced.append(found.reduced)
    assert np.mean(reduced) == pytest.approx(1.0, abs=4.0 * np.std(reduced) / 150**0.5)
    assert 1 <= np.sum(np.array(chances) < 0.05) <= 17  # 7.5 +- 2.7 expected
    assert kstest(chances, "uniform").pvalue > 1e-3


def test_each_mode_takes_a_degree_of_freedom() -> None:
    """Nine directions of 40 pixels: modes and a shift, so that 31 degrees are left.

    As 49 degrees the noise beside the modes looks 0.63 times as large, and p is never small.
    """
    rng = np.random.default_rng(7)
    where = np.zeros(SHAPE, bool)
    where.flat[rng.choice(where.size, 40, replace=False)] = True
    chances = []
    for _ in range(200):
        modes = rng.standard_normal((8, *SHAPE))
        change = rng.standard_normal(SHAPE) + np.einsum("m,mhw", rng.standard_normal(8), modes)
        found = chi_square(change, np.ones(SHAPE), modes, where)
        assert found is not None
        chances.append(found.p_value)
    assert kstest(chances, "uniform").pvalue > 1e-3


def test_a_smooth_difference_is_no_correlation() -> None:
    """0.3 standard errors in every pixel: 16 standard errors of the mean of 2880."""
    change = 0.3 + smooth(np.random.default_rng(3), 0.0)
    found = chi_square(change, np.ones(SHAPE), NONE, EVERYWHERE)
    assert found is not None
    assert found.effective > 0.9 * found.pixels
    assert found.p_value < 0.02


def test_weak_correlation_of_many_pixels_counts() -> None:
    """A tenth of the variance is smooth over 3 pixels: sum rho = 1 + 0.1 (4 pi 3^2 - 1) = 12.2."""
    rng = np.random.default_rng(4)
    found = [
        correlation(0.9**0.5 * smooth(rng, 0.0) + 0.1**0.5 * smooth(rng, 3.0))[1] for _ in range(30)
    ]
    assert 5.0 < np.mean(found) < 15.0  # its far part is below the noise of one image


def test_p_is_not_small_more_often_in_few_pixels_of_correlated_noise() -> None:
    """100 pixels, half of whose variance is smooth over 1 pixel: at most 40 of 400 below 0.05.

    20 +- 4.4 are meant, and 31 are found. With a sill of 1 and distances of an eighth of the edge
    there are 59: no correlation is seen in an image whose errors are large by chance.
    """
    rng = np.random.default_rng(8)
    where = np.zeros(SHAPE, bool)
    where[:10, :10] = True
    chances = []
    for _ in range(400):
        change = 0.5**0.5 * (smooth(rng, 0.0) + smooth(rng, 1.0))
        found = chi_square(change, np.ones(SHAPE), NONE, where)
        assert found is not None
        chances.append(found.p_value)
    assert np.sum(np.array(chances) < 0.05) <= 40


def test_p_is_uniform_with_estimated_variances() -> None:
    """The error of all pixels has 400 degrees of freedom, that of the mode 8; 135 pixels count.

    If both are taken as known, p is below 0.05 in 9 % of the cases.
    """
    rng = np.random.default_rng(5)
    mode = 1.0 + np.indices(SHAPE)[0] / 48.0
    chances: list[float] = []
    known: list[float] = []
    for _ in range(300):
        even, size = (np.sqrt(rng.chisquare(nu) / nu) for nu in (400, 8))
        change = smooth(rng, 2.0) + rng.standard_normal() * mode
        for degrees, found in (((400 / 135, 8.0), chances), ((np.inf, np.inf), known)):
            one = chi_square(
                change, np.full(SHAPE, even), size * mode[None], EVERYWHERE, degrees=degrees
            )
            assert one is not None
            found.append(one.p_value)
    assert 4 <= np.sum(np.array(chances) < 0.05) <= 26  # 15 +- 3.8 expected
    assert np.sum(np.array(known) < 0.05) > np.sum(np.array(chances) < 0.05) + 5


def test_p_is_uniform_over_parts_and_a_shift_is_seen_as_often_as_stated() -> None:
    """Three parts, of which one is small, and a mode; then a shift that is found in 95 %.

    Of 200 draws 190 +- 3.1 find it; the F test of five directions needs more than one alone.
    """
    rng = np.random.default_rng(6)
    columns = np.indices(SHAPE)[1]
    parts = [columns < 5, (columns >= 5) & (columns < 40), columns >= 40]
    modes = np.sin(columns / 10.0)[None]
    chances, found = [], 0
    for _ in range(200):
        change = smooth(rng, 0.0) + rng.standard_normal() * modes[0]
        one = chi_square(change, np.ones(SHAPE), modes, EVERYWHERE, parts=parts)
        assert one is not None
        chances.append(one.p_value)
        more = chi_square(change + one.seen, np.ones(SHAPE), modes, EVERYWHERE, parts=parts)
        assert more is not None
        found += more.p_value < 0.01
    assert kstest(chances, "uniform").pvalue > 0.05
    assert 180 <= found <= 199


def test_p_is_uniform_where_one_part_is_correlated() -> None:
    """Smooth noise in the left quarter alone: 10 of 200 have p below 0.05, give or take 3.1.

    With one correlation for all pixels, of which the quarter has a share, there are 19.
    """
    rng = np.random.default_rng(7)
    left = np.indices(SHAPE)[1] < 15
    found: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(200):
        change = np.where(left, smooth(rng, 2.5), smooth(rng, 0.0))
        for known, chances in found.items():
            strata = (left, ~left) if known else ()
            one = chi_square(change, np.ones(SHAPE), NONE, EVERYWHERE, strata=strata)
            assert one is not None
            chances.append(one.p_value)
    few, many = (int(np.sum(np.array(found[known]) < 0.05)) for known in (True, False))
    assert few <= 17 < many
    assert kstest(found[True], "uniform").pvalue > 0.01


def test_no_pixel_is_none() -> None:
    nan = np.full(SHAPE, np.nan)
    assert chi_square(nan, np.ones(SHAPE), NONE, EVERYWHERE) is None
