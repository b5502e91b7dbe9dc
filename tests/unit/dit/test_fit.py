"""The fit of both lines against scipy, and its errors against repetition."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import cholesky, inv, lstsq, solve_triangular

from cldit.arrays import Floats
from cldit.dit.fit import (
    Pair,
    SharedError,
    apparent_radiance,
    emissivity,
    fit_pair,
    shot_scatter,
)

X = np.array([1.0, 2.5, 6.0, 11.0, 20.0])


def _fit(
    reference: Floats,
    during: Floats,
    variance: tuple[Floats, Floats],
    shared: Floats | None = None,
    slopes: tuple[float, float] = (1.0, 0.3),
) -> Pair:
    pixels = reference.shape[1]
    g, s = (np.full(pixels, slope) for slope in slopes)
    return fit_pair(
        (X, X),
        (reference, during),
        variance=variance,
        usable=np.ones(reference.shape, bool),
        errors=() if shared is None else [SharedError(variance=shared, reference=g, injection=s)],
    )


def _noisy(pixels: int = 7) -> tuple[Any, Any, tuple[Any, Any]]:
    rng = np.random.default_rng(4)
    variance = rng.uniform(0.005, 0.04, (5, pixels)), rng.uniform(0.005, 0.04, (5, pixels))
    reference, during = X[:, None] + 0.5, 0.3 * X[:, None] + 4.0
    noise = rng.standard_normal((2, 5, pixels))
    return (
        reference + noise[0] * variance[0] ** 0.5,
        during + noise[1] * variance[1] ** 0.5,
        variance,
    )


DESIGN = np.zeros((10, 4))
DESIGN[:5, 0] = DESIGN[5:, 2] = X
DESIGN[:5, 1] = DESIGN[5:, 3] = 1.0


def _steady() -> list[SharedError]:
    """Two errors with a course over the backgrounds: an offset, and a gain that goes with it."""
    way = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[:, None] * np.ones(7)
    line = X[:, None]
    return [
        SharedError(
            reference=way * (0.3 + 0.1 * (line + 0.5)), injection=way * (0.3 + 0.1 * (0.3 * line))
        ),
        SharedError(reference=0.05 * way, injection=0.05 * way),
    ]


_BLACK_BODY = SharedError(
    variance=np.array([0.01, 0.03, 0.02, 0.05, 0.04]),
    reference=np.full(7, 0.97),
    injection=np.full(7, 0.31),
)
_OFFSET = SharedError(variance=np.full(5, 200.0), reference=np.ones(7), injection=np.ones(7))
_GAIN = SharedError(
    variance=np.linspace(1e-4, 4e-4, 5),
    reference=X[:, None] + 0.5 * np.ones(7),
    injection=0.3 * X[:, None] + 4.0 * np.ones(7),
)


@pytest.mark.parametrize(
    "errors",
    [[], [_BLACK_BODY], [_BLACK_BODY, _OFFSET, _GAIN], _steady(), [_BLACK_BODY, *_steady()]],
)
def test_lines_are_generalised_least_squares(errors: list[SharedError]) -> None:
    """Against scipy: the 10 x 10 covariance of the means with all errors, whitened by its Cholesky
    factor, then lstsq. The offset has 1e4 times the variance of the noise."""
    reference, during, variance = _noisy()
    lines = fit_pair(
        (X, X),
        (reference, during),
        variance=variance,
        usable=np.ones((5, 7), bool),
        errors=errors,
    )
    for pixel in range(7):
        covariance = np.diag(np.concatenate(variance)[:, pixel])
        for error in errors:
            factors = (np.broadcast_to(f, (5, 7)) for f in (error.reference, error.injection))
            u = np.concatenate([factor[:, pixel] for factor in factors])
            each = np.ones((5, 5)) if error.variance is None else np.diag(error.variance)
            covariance += np.kron(np.ones((2, 2)), each) * np.outer(u, u)
        factor = cholesky(covariance, lower=True)
        white = solve_triangular(factor, DESIGN, lower=True)
        seen = np.concatenate([reference[:, pixel], during[:, pixel]])
        best, misfit, *_ = lstsq(white, solve_triangular(factor, seen, lower=True))
        np.testing.assert_allclose(lines.values[pixel], best, rtol=1e-7)
        np.testing.assert_allclose(lines.covariance[pixel], inv(white.T @ white), rtol=1e-6)
        assert lines.chi2[pixel] == pytest.approx(misfit, rel=1e-6)


def test_a_common_error_drops_out_of_a_transparent_spray() -> None:
    """What shifts both kinds alike is no emissivity, however large it is beside the noise."""
    shift = np.array([0.3, -0.2, 0.4, -0.5, 0.1])[:, None]
    quiet = np.full((5, 1), 1e-6)
    reference = X[:, None] + shift
    lines = _fit(reference, reference, (quiet, quiet), np.full(5, 0.1), (1.0, 1.0))
    # The shifts' variance is 1e5 times the noise's: so many times rounding, and some, is lost.
    assert emissivity(lines)[0][0] == pytest.approx(0.0, abs=1e-10)
    # Each line's slope is as uncertain as the shifts make it, their ratio is not.
    assert lines.covariance[0, 0, 0] > 1e4 * emissivity(lines)[1][0]


def test_equal_weights_are_the_fit_of_the_difference() -> None:
    """With equal x and weights, -epsilon and epsilon I are Delta I's line, Eq. (2) of the paper."""
    reference, during, (variance, _) = _noisy()
    lines = _fit(reference, during, (variance, variance))
    for pixel in range(7):
        (slope, intercept), covariance = np.polyfit(
            X,
            (during - reference)[:, pixel],
            1,
            w=(2 * variance[:, pixel]) ** -0.5,
            cov="unscaled",
        )
        g = lines.values[pixel, 0]
        assert emissivity(lines)[0][pixel] == pytest.approx(-slope / g, rel=1e-9)
        radiance, error = apparent_radiance(lines)
        assert radiance[pixel] == pytest.approx(-intercept / slope, rel=1e-9)
        ratio = radiance[pixel]
        textbook = covariance[1, 1] + ratio**2 * covariance[0, 0] + 2 * ratio * covariance[0, 1]
        assert error[pixel] == pytest.approx(textbook / slope**2, rel=1e-8)


@pytest.mark.parametrize("shared", [0.0, 0.02])
def test_errors_by_brute_force(shared: float) -> None:
    """Propagated standard errors against 20000 repetitions of one pixel."""
    rng = np.random.default_rng(8)
    calm, varied = 0.02 * np.sqrt(X), 0.03 * np.sqrt(X)
    moved = X[:, None] + shared * rng.standard_normal((5, 20000))
    reference = moved + calm[:, None] * rng.standard_normal((5, 20000))
    during = 0.4 * moved + 2.0 + varied[:, None] * rng.standard_normal((5, 20000))
    variance = tuple(np.broadcast_to(noise[:, None] ** 2, (5, 20000)) for noise in (calm, varied))
    lines = _fit(
        reference, during, (variance[0], variance[1]), np.full(5, shared**2), slopes=(1.0, 0.4)
    )
    for value, stated in (emissivity(lines), apparent_radiance(lines)):
        # sample variance of 20000: 1 %; 4 sigma, and 1 % for the second order of the propagation
        assert np.var(value) == pytest.approx(np.mean(stated), rel=0.05)
    # 6 degrees of freedom: the mean of 20000 is good to sqrt(12 / 20000) = 0.4 %; 4 of them
    assert np.mean(lines.chi2) / 6 == pytest.approx(1.0, abs=0.017)


def test_degenerate_lines_are_nan() -> None:
    """Twice the same background; a single one; none: NaN, while the pixel beside has its value."""
    usable = np.array([[1, 1, 0, 1], [1, 0, 0, 1], [0, 0, 0, 1]], bool)
    x = np.array([1.0, 1.0, 2.0])
    ones = np.ones((3, 4))
    lines = fit_pair(
        (x, x),
        (x[:, None] * ones, 0.5 * x[:, None] * ones),
        variance=(ones, ones),
        usable=usable,
    )
    assert np.isnan(lines.values[:3]).all() and np.isnan(lines.chi2[:3]).all()
    np.testing.assert_allclose(lines.values[3], [1.0, 0.0, 0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize(("q", "p"), [(0.0, 0.0), (0.04, 0.0), (0.0, 9.0), (0.04, 9.0)])
def test_scatter_is_found(q: float, p: float) -> None:
    """The variance of known scatter, averaged over 4000 pixels of 20 degrees of freedom each."""
    rng = np.random.default_rng(6)
    difference = np.broadcast_to(np.array([[-1.0], [3.0], [8.0], [15.0], [30.0]]), (5, 4000))
    camera = np.full((5, 4000), 1.5)
    truth = camera + q * difference**2 + p
    observed = truth * rng.chisquare(4, (5, 4000)) / 4
    extra = shot_scatter(
        difference, observed, camera=camera, degrees=np.full((5, 1), 4.0), shape=(40, 100)
    )
    # A square over its estimated variance has the mean 1. Backgrounds have 2 of 5 numbers on
    # average, so that 444 neighbourhoods of 180 * 2 / 5 degrees of freedom are good to 0.8 %.
    squares = np.mean(truth / (camera + extra))
    assert squares == pytest.approx(1.0, abs=0.025)
    even = shot_scatter(
        np.ones_like(difference),
        observed,
        camera=camera,
        degrees=np.full((5, 1), 4.0),
        shape=(40, 100),
    )
    assert np.isfinite(even).all()
    none = shot_scatter(
        difference, observed, camera=camera, degrees=np.zeros((5, 1)), shape=(40, 100)
    )
    np.testing.assert_array_equal(none, 0.0)
