"""The fit of both lines against scipy, and its errors against repetition."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import cholesky, inv, lstsq, solve_triangular
from scipy.optimize import curve_fit

from cldit.dit.fit import (
    CommonError,
    Pair,
    SteadyError,
    apparent_radiance,
    emissivity,
    fit_pair,
    shot_scatter,
)

X = np.array([1.0, 2.5, 6.0, 11.0, 20.0])


def _fit(
    reference: NDArray[np.float64],
    during: NDArray[np.float64],
    variance: tuple[NDArray[np.float64], NDArray[np.float64]],
    shared: NDArray[np.float64] | None = None,
    slopes: tuple[float, float] = (1.0, 0.3),
) -> Pair:
    pixels = reference.shape[1]
    g, s = (np.full(pixels, slope) for slope in slopes)
    return fit_pair(
        (X, X),
        (reference, during),
        variance=variance,
        usable=np.ones(reference.shape, bool),
        common=() if shared is None else [CommonError(variance=shared, reference=g, injection=s)],
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


def _check_generalised(
    lines: Pair, pixel: int, covariance: NDArray[np.float64], means: Any, *, rtol: float
) -> None:
    """One pixel of the `lines` against scipy: the 10 x 10 covariance of the `means`, whitened by
    its Cholesky factor, then lstsq."""
    factor = cholesky(covariance, lower=True)
    white = solve_triangular(factor, DESIGN, lower=True)
    seen = np.concatenate([kind[:, pixel] for kind in means])
    best, misfit, *_ = lstsq(white, solve_triangular(factor, seen, lower=True))
    np.testing.assert_allclose(lines.values[pixel], best, rtol=rtol)
    np.testing.assert_allclose(lines.covariance[pixel], inv(white.T @ white), rtol=10.0 * rtol)
    assert lines.chi2[pixel] == pytest.approx(misfit, rel=10.0 * rtol)


def test_without_shared_error_both_lines_are_scipys() -> None:
    """Slope, intercept and covariance of curve_fit with absolute_sigma, pixel by pixel."""
    reference, during, variance = _noisy()
    lines = _fit(reference, during, variance)
    for pixel in range(7):
        for start, signal, of in ((0, reference, variance[0]), (2, during, variance[1])):
            best, covariance = curve_fit(
                lambda x, a, b: a * x + b,
                X,
                signal[:, pixel],
                sigma=np.sqrt(of[:, pixel]),
                absolute_sigma=True,
            )
            columns = slice(start, start + 2)
            np.testing.assert_allclose(lines.values[pixel, columns], best, rtol=1e-6)
            # curve_fit differentiates numerically
            np.testing.assert_allclose(
                lines.covariance[pixel, columns, columns], covariance, rtol=1e-5
            )


def test_shared_errors_are_generalised_least_squares() -> None:
    """Against scipy: the whole 10 x 10 covariance, whitened by its Cholesky factor, then lstsq."""
    reference, during, variance = _noisy()
    shared = np.array([0.01, 0.03, 0.02, 0.05, 0.04])
    g, s = 0.97, 0.31
    lines = _fit(reference, during, variance, shared, (g, s))
    for pixel in range(7):
        a, b = (np.diag(of[:, pixel]) for of in variance)
        d = np.diag(shared)
        covariance = np.block([[a + g * g * d, g * s * d], [g * s * d, b + s * s * d]])
        _check_generalised(lines, pixel, covariance, (reference, during), rtol=1e-9)


def test_several_common_errors_are_generalised_least_squares() -> None:
    """Black body, offset and gain together, the offset 1e4 times the noise: scipy, whitened."""
    reference, during, variance = _noisy(1)
    g, s = np.array([0.97]), np.array([0.31])
    ones = np.ones(1)
    common = [
        CommonError(variance=np.full(5, 0.03), reference=g, injection=s),
        CommonError(variance=np.full(5, 200.0), reference=ones, injection=ones),
        CommonError(variance=np.linspace(1e-4, 4e-4, 5), reference=reference, injection=during),
    ]
    lines = fit_pair(
        (X, X),
        (reference, during),
        variance=variance,
        usable=np.ones((5, 1), bool),
        common=common,
    )
    covariance = np.diag(np.concatenate(variance)[:, 0])
    for number in range(5):
        for error in common:
            p, q = (
                float(np.broadcast_to(f, (5, 1))[number, 0])
                for f in (error.reference, error.injection)
            )
            means = [number, number + 5]
            covariance[np.ix_(means, means)] += error.variance[number] * np.outer([p, q], [p, q])
    _check_generalised(lines, 0, covariance, (reference, during), rtol=1e-7)


def _steady(pixels: int) -> list[SteadyError]:
    """Two errors with a course over the backgrounds: an offset, and a gain that goes with it."""
    way = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[:, None] * np.ones(pixels)
    line = X[:, None]
    return [
        SteadyError(
            reference=way * (0.3 + 0.1 * (line + 0.5)), injection=way * (0.3 + 0.1 * (0.3 * line))
        ),
        SteadyError(reference=0.05 * way, injection=0.05 * way),
    ]


@pytest.mark.parametrize("with_common", [False, True])
def test_steady_errors_are_generalised_least_squares(with_common: bool) -> None:
    """Against scipy, with u u' of either steady error in the whole 10 x 10 covariance."""
    reference, during, variance = _noisy()
    shared = CommonError(variance=np.full(5, 0.03), reference=np.ones(7), injection=np.ones(7))
    lines = fit_pair(
        (X, X),
        (reference, during),
        variance=variance,
        usable=np.ones((5, 7), bool),
        common=[shared] if with_common else [],
        steady=_steady(7),
    )
    for pixel in range(7):
        covariance = np.diag(np.concatenate(variance)[:, pixel])
        if with_common:
            covariance += 0.03 * np.kron(np.ones((2, 2)), np.eye(5))
        for error in _steady(7):
            u = np.concatenate([error.reference, error.injection])[:, pixel]
            covariance += np.outer(u, u)
        _check_generalised(lines, pixel, covariance, (reference, during), rtol=1e-9)


def test_a_steady_error_of_size_one_has_the_stated_mean_squares() -> None:
    """20000 pixels with the same drift: chi2 of all four numbers is 1 within 5 of its errors."""
    rng = np.random.default_rng(8)
    pixels = 20_000
    variance = np.full((5, pixels), 0.02)
    drift = _steady(pixels)[0]
    truth = np.array([1.0, 0.5, 0.3, 4.0])
    noise = np.sqrt(variance) * rng.standard_normal((2, 5, pixels))
    lines = fit_pair(
        (X, X),
        (
            X[:, None] + 0.5 + drift.reference + noise[0],
            0.3 * X[:, None] + 4.0 + drift.injection + noise[1],
        ),
        variance=(variance, variance),
        usable=np.ones((5, pixels), bool),
        steady=[drift],
    )
    stated = np.diagonal(lines.covariance, axis1=1, axis2=2).mean(axis=0)
    mean_squares = np.mean((lines.values - truth) ** 2, axis=0)
    np.testing.assert_allclose(mean_squares / stated, 1.0, atol=5.0 * np.sqrt(2.0 / pixels))


def test_an_offset_of_the_camera_leaves_the_fit_of_the_difference() -> None:
    """Eq. (2)'s immunity: an offset before each background, any size, moves neither result."""
    reference, during, (variance, _) = _noisy()
    ones = np.ones(7)
    offset = 50.0 * np.array([0.0, 1.0, 2.0, 3.0, 4.0])[:, None]
    error = CommonError(variance=np.full(5, 1e4), reference=ones, injection=ones)
    fits = [
        fit_pair(
            (X, X),
            (reference + shift, during + shift),
            variance=(variance, variance),
            usable=np.ones((5, 7), bool),
            common=[error],
        )
        for shift in (0.0, offset)
    ]
    kelvin = [apparent_radiance(lines)[0] for lines in fits]
    # The rest is the offset's own prior: 1e4 against 1e-2 of noise.
    np.testing.assert_allclose(kelvin[1], kelvin[0], rtol=1e-4)


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
