"""The evaluation of recorded shots returns the truth that they were made from.

Rationale: bias and standard errors over everything the measurement equation holds at once: grey
background, reflected surroundings, two windows, a camera whose pixels differ in gain and offset.

Set-up: blocks of 48 x 48 pixels see one spray each, emissivity 0.05 to 1 at 430 K, before five
backgrounds; shots with photon and read noise, rounded to counts. Expected: mean of the apparent
temperature within 0.1 K of the truth, spread as stated, and the same lines as scipy's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.camera.curve import Curve, fit_curve
from cldit.dit.maps import Maps, Reason
from cldit.dit.recorded import evaluate_shots
from cldit.errors import EvaluationError
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from tests.verify.evaluation_bias import (
    BARE,
    CAMERA,
    EMISSIVITIES,
    FILTER_UM,
    FULL,
    TRUTH_K,
    record,
)

EMISSIVITY = np.array(EMISSIVITIES)


def _split(image: NDArray[np.float32]) -> Floats:
    """(6, pixels) by emissivity."""
    return np.stack(
        [part.ravel() for part in np.split(image.astype(float), len(EMISSIVITY), axis=1)]
    )


def _check(maps: Maps, *, spread: float = 0.16) -> None:
    """2304 pixels: their mean is good to 2 % of a standard error, chi2 / N to 3 %.

    `spread`: 4 of these 3 %, and what an estimated scatter between shots adds (+2 % of the
    variance at 40 shots and 195 degrees of freedom), and, at an emissivity of 0.05, second order.
    """
    found, error = (
        _split(image)
        for image in (maps.apparent_temperature_K, maps.apparent_temperature_standard_error_K)
    )
    assert np.isfinite(found).mean() > 0.99  # 3 standard errors at 0.05 are not met by all
    mean_error = np.nanmean(error, axis=1) / np.sqrt(found.shape[1])
    bias = np.nanmean(found, axis=1) - TRUTH_K
    assert np.all(np.abs(bias) < 0.1), bias
    assert np.all(mean_error < 0.04)  # so that the line above means something
    ratio = np.nanvar(found, axis=1) / np.nanmean(error**2, axis=1)
    np.testing.assert_allclose(ratio, 1.0, atol=spread)
    through, error = (_split(i) for i in (maps.emissivity, maps.emissivity_standard_error))
    away = (np.mean(through, axis=1) - EMISSIVITY) / np.mean(error, axis=1)
    assert np.all(np.abs(away) < 0.1)  # 2 % of a standard error, 5 of them
    np.testing.assert_allclose(np.var(through, axis=1) / np.mean(error**2, axis=1), 1, atol=spread)
    assert np.mean(maps.reduced_chi2) == pytest.approx(1.0, abs=0.05)
    # A p value is even between 0 and 1: 13824 pixels, quarter counts to 1.3 %, 5 of these.
    below = np.mean(maps.fit_probability < 0.25)
    assert below == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize("pattern", [False, True])
@pytest.mark.parametrize("around", [BARE, FULL])
def test_truth_comes_back(around: Surroundings, pattern: bool) -> None:
    _check(evaluate_shots(record(around, pattern=pattern)).maps)


def test_unsteady_backgrounds_are_in_the_errors() -> None:
    """0.3 K from one set point to the next, said to the evaluation and not.

    Opaque, that is the larger part of the error; an emissivity of 0.05 hardly feels it. Each pixel
    has its own black body here, so that the pixels show what is not said.
    """
    recorded = record(background_error_K=0.3)
    ratio = {}
    for told in (0.0, 0.3):
        recorded.surroundings = replace(BARE, background_error_K=told)
        maps = evaluate_shots(recorded).maps
        found, error = (
            _split(image)
            for image in (maps.apparent_temperature_K, maps.apparent_temperature_standard_error_K)
        )
        ratio[told] = np.nanvar(found, axis=1) / np.nanmean(error**2, axis=1)
        assert np.all(np.abs(np.nanmean(found, axis=1) - TRUTH_K) < 0.1)
    np.testing.assert_allclose(ratio[0.3], 1.0, atol=0.16)
    assert np.all(ratio[0.0] < 1.2)


def test_error_grows_without_bound_as_the_spray_vanishes() -> None:
    """Proportional to 1 / emissivity while there is a temperature, and then none, and said so."""
    recorded = record(shots=10, side=16)
    epsilon = np.geomspace(1.0, 1e-3, EMISSIVITY.size * 16)[None, :] * np.ones((16, 1))
    own = float(band_radiance(TRUTH_K, filter_um=FILTER_UM))
    shots = []
    for shot in recorded.shots:
        light = band_radiance(shot.background_K, filter_um=FILTER_UM) * np.ones_like(epsilon)
        if shot.kind == "injection":
            light = (1.0 - epsilon) * light + epsilon * own
        shots.append(replace(shot, image=np.rint(CAMERA.counts(light)).astype(np.uint16)))
    recorded.shots = shots
    maps = evaluate_shots(recorded, accept=["repeats"]).maps
    error = maps.apparent_temperature_standard_error_K
    told = maps.reason == Reason.OK
    assert 0.2 < told.mean() < 0.9
    faint = told & (epsilon < 0.3)
    product = (error * epsilon)[faint]
    np.testing.assert_allclose(product, np.median(product), rtol=0.2)
    assert np.all(maps.reason[~told] == Reason.EMISSIVITY_TOO_LOW)
    assert np.isnan(maps.apparent_temperature_K[~told]).all()
    # Its emissivity is still told, with its error.
    limit = 3.0 * maps.emissivity_standard_error
    assert np.all(maps.emissivity[~told] <= limit[~told])


@pytest.mark.parametrize("around", [BARE, FULL])
def test_fitted_curve_makes_up_for_a_wrong_filter(around: Surroundings) -> None:
    """Recorded through 3.40 to 3.60 um, evaluated as 3.30 to 3.50 um.

    Planck's curve is then wrong by more than 1 K below the backgrounds; the references give the
    wavelengths back to 0.1 % and with them the temperature, and the right filter is left alone.
    """
    recorded = record(around, side=24, filter_um=(3.4, 3.6))
    wrong = _split(evaluate_shots(recorded).maps.apparent_temperature_K).mean(axis=1)
    fitted = evaluate_shots(recorded, curve="fitted")
    right = _split(fitted.maps.apparent_temperature_K).mean(axis=1)
    assert fitted.fitted is not None
    # Middles of the filters; what windows let through shifts it by a little.
    assert fitted.fitted.curve.stretch == pytest.approx(3.5 / 3.4, abs=3e-3)
    opaque = EMISSIVITY > 0.5
    assert np.all(np.abs(wrong - TRUTH_K)[opaque] > 3 * np.abs(right - TRUTH_K)[opaque])
    assert np.all(np.abs(right - TRUTH_K)[opaque] < 0.1)
    same = evaluate_shots(record(around, side=24), curve="fitted")
    assert same.fitted is not None
    assert same.fitted.curve.stretch == pytest.approx(1.0, abs=2e-3)
    kelvin = _split(same.maps.apparent_temperature_K).mean(axis=1)
    assert np.all(np.abs(kelvin - TRUTH_K)[opaque] < 0.1)


def test_curves_that_cannot_be_fitted() -> None:
    kelvin = np.array([400.0, 450.0, 500.0, 550.0])
    counts = Curve(filter_um=FILTER_UM).radiance(kelvin)
    with pytest.raises(EvaluationError, match="at least three"):
        fit_curve(kelvin[:2], counts[:2], filter_um=FILTER_UM)
    with pytest.raises(EvaluationError, match="do not lie on the curve"):
        fit_curve(kelvin, counts[::-1], filter_um=FILTER_UM)
    with pytest.raises(EvaluationError, match="do not lie on the curve"):
        fit_curve(kelvin, kelvin, filter_um=FILTER_UM)


@pytest.mark.parametrize("stretch", [0.85, 1.0, 1.1])
def test_curve_and_its_inverse(stretch: float) -> None:
    curve = Curve(filter_um=FILTER_UM, stretch=stretch)
    kelvin = np.geomspace(100.0, 2000.0, 50)
    radiance = curve.radiance(kelvin)
    np.testing.assert_allclose(curve.temperature(radiance), kelvin, rtol=1e-10)
    step = (curve.radiance(kelvin * 1.0001) - curve.radiance(kelvin * 0.9999)) / (2e-4 * kelvin)
    np.testing.assert_allclose(curve.slope(kelvin), step, rtol=1e-5)
    np.testing.assert_allclose(curve.temperature_slope(radiance), 1.0 / step, rtol=1e-5)
    fit = fit_curve(
        np.linspace(400, 560, 5), curve.radiance(np.linspace(400, 560, 5)), filter_um=FILTER_UM
    )
    assert fit.curve.stretch == pytest.approx(stretch, rel=1e-6)
