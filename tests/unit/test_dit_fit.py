"""The fit against scipy, the maps' reasons, and what the evaluation refuses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import cholesky, inv, lstsq, solve_triangular
from scipy.optimize import curve_fit

from cldit.camera.calibration import Calibration
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.fit import Pair, apparent_radiance, emissivity, fit_pair, shot_scatter
from cldit.dit.maps import Maps, Reason
from cldit.dit.recorded import evaluate_acquisition
from cldit.errors import EvaluationError, RunFolderError
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights

AROUND = Surroundings(wall_temperature_K=300.0)
FILTER = (3.3, 3.5)
CALIBRATION = Calibration(
    filter_um=FILTER,
    counts_per_radiance=1.36e-17,
    offset_counts=200.0,
    electrons_per_count=40.0,
    read_noise_electrons=200.0,
    saturation_counts=16383.0,
)
BACKGROUNDS = (400.0, 440.0, 480.0, 520.0, 560.0)


def _radiance(kelvin: float) -> float:
    return float(band_radiance(kelvin, filter_um=FILTER))


@dataclass(frozen=True)
class _Shot:
    id: str
    kind: str
    background_setpoint_K: float
    background_K: float


@dataclass
class _Acquisition:
    shots: list[_Shot]
    images: dict[str, NDArray[Any]]
    calibration: dict[str, Any]
    bad_pixels: NDArray[np.bool_] | None = None
    surroundings: Surroundings = AROUND

    def load(self, shot: _Shot) -> NDArray[Any]:
        return self.images[shot.id]


def _acquisition(
    *, transmitted: NDArray[np.float64], emitted: NDArray[np.float64], shots: int = 1
) -> _Acquisition:
    """Without noise, but rounded to counts."""
    found: list[_Shot] = []
    images: dict[str, NDArray[Any]] = {}
    for kelvin in BACKGROUNDS:
        for kind in ("reference", "injection"):
            for number in range(shots):
                shot = _Shot(f"{kelvin:g}-{kind}-{number}", kind, kelvin, kelvin)
                radiance = np.full(transmitted.shape, _radiance(kelvin))
                if kind == "injection":
                    radiance = radiance * transmitted + emitted
                found.append(shot)
                images[shot.id] = np.rint(CALIBRATION.counts(radiance)).astype(np.uint16)
    return _Acquisition(found, images, CALIBRATION.to_dict())


def _spray(shape: tuple[int, int] = (6, 8)) -> _Acquisition:
    transmitted = np.linspace(0.1, 0.9, shape[0] * shape[1]).reshape(shape)
    return _acquisition(transmitted=transmitted, emitted=(1 - transmitted) * _radiance(450.0))


X = np.array([1.0, 2.5, 6.0, 11.0, 20.0])


def _fit(
    before: NDArray[np.float64],
    during: NDArray[np.float64],
    variance: tuple[NDArray[np.float64], NDArray[np.float64]],
    shared: NDArray[np.float64] | None = None,
    slopes: tuple[float, float] = (1.0, 0.3),
) -> Pair:
    pixels = before.shape[1]
    return fit_pair(
        (X, X),
        (before, during),
        variance=variance,
        usable=np.ones(before.shape, bool),
        shared=np.zeros(5) if shared is None else shared,
        slopes=(np.full(pixels, slopes[0]), np.full(pixels, slopes[1])),
    )


def _noisy(pixels: int = 7) -> tuple[Any, Any, tuple[Any, Any]]:
    rng = np.random.default_rng(4)
    variance = rng.uniform(0.005, 0.04, (5, pixels)), rng.uniform(0.005, 0.04, (5, pixels))
    before, during = X[:, None] + 0.5, 0.3 * X[:, None] + 4.0
    noise = rng.standard_normal((2, 5, pixels))
    return before + noise[0] * variance[0] ** 0.5, during + noise[1] * variance[1] ** 0.5, variance


def test_without_shared_error_both_lines_are_scipys() -> None:
    """Slope, intercept and covariance of curve_fit with absolute_sigma, pixel by pixel."""
    before, during, variance = _noisy()
    lines = _fit(before, during, variance)
    for pixel in range(7):
        for start, signal, of in ((0, before, variance[0]), (2, during, variance[1])):
            best, covariance = curve_fit(
                lambda x, a, b: a * x + b,
                X,
                signal[:, pixel],
                sigma=np.sqrt(of[:, pixel]),
                absolute_sigma=True,
            )
            both = slice(start, start + 2)
            np.testing.assert_allclose(lines.values[pixel, both], best, rtol=1e-6)
            # curve_fit differentiates numerically
            np.testing.assert_allclose(lines.covariance[pixel, both, both], covariance, rtol=1e-5)


def test_shared_errors_are_generalised_least_squares() -> None:
    """Against scipy: the whole 10 x 10 covariance, whitened by its Cholesky factor, then lstsq."""
    before, during, variance = _noisy()
    shared = np.array([0.01, 0.03, 0.02, 0.05, 0.04])
    g, s = 0.97, 0.31
    lines = _fit(before, during, variance, shared, (g, s))
    design = np.zeros((10, 4))
    design[:5, 0] = design[5:, 2] = X
    design[:5, 1] = design[5:, 3] = 1.0
    for pixel in range(7):
        a, b = (np.diag(of[:, pixel]) for of in variance)
        d = np.diag(shared)
        whole = np.block([[a + g * g * d, g * s * d], [g * s * d, b + s * s * d]])
        factor = cholesky(whole, lower=True)
        white = solve_triangular(factor, design, lower=True)
        seen = np.concatenate([before[:, pixel], during[:, pixel]])
        best, misfit, *_ = lstsq(white, solve_triangular(factor, seen, lower=True))
        np.testing.assert_allclose(lines.values[pixel], best, rtol=1e-9)
        np.testing.assert_allclose(lines.covariance[pixel], inv(white.T @ white), rtol=1e-8)
        assert lines.chi2[pixel] == pytest.approx(misfit, rel=1e-8)


def test_a_common_error_drops_out_of_a_transparent_spray() -> None:
    """What shifts both kinds alike is no emissivity, however large it is beside the noise."""
    shift = np.array([0.3, -0.2, 0.4, -0.5, 0.1])[:, None]
    quiet = np.full((5, 1), 1e-6)
    before = X[:, None] + shift
    known = _fit(before, before, (quiet, quiet), np.full(5, 0.1), (1.0, 1.0))
    # The shifts' variance is 1e5 times the noise's: so many times rounding, and some, is lost.
    assert emissivity(known)[0][0] == pytest.approx(0.0, abs=1e-10)
    # Each line's slope is as uncertain as the shifts make it, their ratio is not.
    assert known.covariance[0, 0, 0] > 1e4 * emissivity(known)[1][0]


def test_equal_weights_are_the_fit_of_the_difference() -> None:
    """With equal x and weights, -epsilon and epsilon I are Delta I's line, Eq. (2) of the paper."""
    before, during, (variance, _) = _noisy()
    lines = _fit(before, during, (variance, variance))
    for pixel in range(7):
        (slope, intercept), covariance = np.polyfit(
            X,
            (during - before)[:, pixel],
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
    before = moved + calm[:, None] * rng.standard_normal((5, 20000))
    during = 0.4 * moved + 2.0 + varied[:, None] * rng.standard_normal((5, 20000))
    variance = tuple(np.broadcast_to(one[:, None] ** 2, (5, 20000)) for one in (calm, varied))
    lines = _fit(
        before, during, (variance[0], variance[1]), np.full(5, shared**2), slopes=(1.0, 0.4)
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
        shared=np.zeros(3),
        slopes=(ones[0], ones[0]),
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
    extra = shot_scatter(difference, observed, camera=camera, degrees=np.full((5, 1), 4.0))
    total = (camera + extra).mean(axis=1)
    # Positive parts only, and fitted weights: some bias is expected, and stated as such.
    np.testing.assert_allclose(total, truth[:, 0], rtol=0.3)
    none = shot_scatter(difference, observed, camera=camera, degrees=np.zeros((5, 1)))
    np.testing.assert_array_equal(none, 0.0)


def test_acquisition_without_noise() -> None:
    acquisition = _spray()
    seen: list[tuple[int, int]] = []
    maps = evaluate_acquisition(acquisition, progress=lambda *at: seen.append(at))
    assert seen == [(n, 10) for n in range(1, 11)]
    expected = 1 - np.linspace(0.1, 0.9, 48).reshape(6, 8)
    # rounding to counts: 0.3 counts of 6000
    np.testing.assert_allclose(maps.emissivity, expected, atol=5e-4)
    np.testing.assert_allclose(maps.apparent_temperature_K, 450.0, atol=1.0)
    assert maps.count() == {Reason.OK: 48}
    assert maps.emissivity.dtype == np.float32 and maps.reason.dtype == np.uint8


def test_drifting_background_is_allowed_for() -> None:
    """References before the black body has settled: 3 K below the injections."""
    acquisition = _spray()
    for index, shot in enumerate(acquisition.shots):
        if shot.kind == "reference":
            acquisition.shots[index] = replace(shot, background_K=shot.background_setpoint_K - 3.0)
            radiance = np.full((6, 8), _radiance(shot.background_setpoint_K - 3.0))
            counts = np.rint(CALIBRATION.counts(radiance)).astype(np.uint16)
            acquisition.images[shot.id] = counts
    maps = evaluate_acquisition(acquisition)
    expected = 1 - np.linspace(0.1, 0.9, 48).reshape(6, 8)
    np.testing.assert_allclose(maps.emissivity, expected, atol=5e-4)


def test_every_reason() -> None:
    acquisition = _spray()
    bad = np.zeros((6, 8), dtype=bool)
    bad[0, 0] = True
    acquisition.bad_pixels = bad
    for shot in acquisition.shots:
        image = acquisition.images[shot.id]
        image[0, 0] = 0
        image[0, 1] = 16383 if shot.background_setpoint_K > 400 else image[0, 1]
        image[0, 2] = 16383 if shot.background_setpoint_K > 500 else image[0, 2]
        image[1, 0] = 200 + 9  # a wall, not the background
        if shot.kind == "injection":
            calm = acquisition.images[f"{shot.background_setpoint_K:g}-reference-0"]
            image[1, 1] = calm[1, 1]
            image[1, 2] = np.rint((calm[1, 2] - 200.0) * 0.5) + 200 - 60
    maps = evaluate_acquisition(acquisition)
    expected = np.zeros((6, 8), np.uint8)
    expected[0, 0] = Reason.BAD_PIXEL
    expected[0, 1] = Reason.SATURATED
    expected[1, 0] = Reason.BACKGROUND_NOT_VISIBLE
    expected[1, 1] = Reason.EMISSIVITY_TOO_LOW
    expected[1, 2] = Reason.NEGATIVE_RADIANCE
    np.testing.assert_array_equal(maps.reason, expected)
    assert maps.count()[Reason.OK] == 43
    unknown = np.isin(expected, [Reason.BAD_PIXEL, Reason.SATURATED, Reason.BACKGROUND_NOT_VISIBLE])
    np.testing.assert_array_equal(np.isnan(maps.emissivity), unknown)
    np.testing.assert_array_equal(np.isnan(maps.emissivity_standard_error), unknown)
    np.testing.assert_array_equal(np.isnan(maps.apparent_temperature_K), expected > 0)
    # Two backgrounds saturated: the other three still give the answer, with a larger error.
    error = maps.emissivity_standard_error
    assert maps.emissivity[0, 2] == pytest.approx(1 - (0.1 + 2 * 0.8 / 47), abs=2e-3)
    assert error[0, 2] > 2 * error[0, 3]


def test_one_saturated_exposure_spoils_its_background() -> None:
    transmitted = np.full((1, 2), 0.5)
    acquisition = _acquisition(
        transmitted=transmitted, emitted=0.5 * np.full((1, 2), _radiance(450.0)), shots=3
    )
    acquisition.images["560-injection-1"][0, 0] = 16383
    maps = evaluate_acquisition(acquisition)
    assert maps.emissivity[0, 0] == pytest.approx(0.5, abs=2e-3)


def test_saved_and_loaded(tmp_path: Path) -> None:
    maps = evaluate_acquisition(_spray())
    maps.save(tmp_path / "maps", pixel_m=(1e-4, 2e-4))
    back = Maps.load(tmp_path / "maps")
    for name in ("emissivity", "apparent_temperature_K", "reason", "reduced_chi2"):
        np.testing.assert_array_equal(getattr(back, name), getattr(maps, name))
    (tmp_path / "maps" / "reason.tif").unlink()
    with pytest.raises(RunFolderError, match=r"reason\.tif"):
        Maps.load(tmp_path / "maps")


def _drop(acquisition: _Acquisition, kind: str, setpoint: float) -> None:
    acquisition.shots = [
        s for s in acquisition.shots if (s.kind, s.background_setpoint_K) != (kind, setpoint)
    ]


def test_refuses_incomplete_recordings() -> None:
    one = _spray()
    one.shots = [s for s in one.shots if s.background_setpoint_K == 400]
    with pytest.raises(EvaluationError, match=r"\[400.0\] K; .* at least two"):
        evaluate_acquisition(one)
    empty = _spray()
    empty.shots = []
    with pytest.raises(EvaluationError, match="at least two"):
        evaluate_acquisition(empty)
    for kind in ("reference", "injection"):
        gap = _spray()
        _drop(gap, kind, 480.0)
        with pytest.raises(EvaluationError, match=f"background 480 K: no {kind}"):
            evaluate_acquisition(gap)


def test_refuses_bad_shots() -> None:
    still = _spray()
    still.shots = [replace(s, background_K=440.0) for s in still.shots]
    with pytest.raises(EvaluationError, match=r"\[440.0\] K"):
        evaluate_acquisition(still)
    cold = _spray()
    cold.shots = [replace(s, background_K=0.5 + s.background_setpoint_K / 1e3) for s in cold.shots]
    with pytest.raises(EvaluationError, match="the same radiance"):
        evaluate_acquisition(cold)
    lost = _spray()
    lost.shots[3] = replace(lost.shots[3], background_K=float("nan"))
    with pytest.raises(EvaluationError, match="440-injection-0: background at nan"):
        evaluate_acquisition(lost)
    odd = _spray()
    odd.shots[3] = replace(odd.shots[3], kind="dark")
    with pytest.raises(EvaluationError, match="440-injection-0: kind 'dark'"):
        evaluate_acquisition(odd)
    cut = _spray()
    cut.images["440-injection-0"] = cut.images["440-injection-0"][:-1]
    with pytest.raises(EvaluationError, match=r"440-injection-0: picture of shape \(5, 8\)"):
        evaluate_acquisition(cut)
    swapped = _spray()
    swapped.shots = [
        replace(s, kind="injection" if s.kind == "reference" else "reference")
        for s in swapped.shots
    ]
    with pytest.raises(EvaluationError, match="swapped"):
        evaluate_acquisition(swapped)


def test_an_empty_scene_is_no_swap() -> None:
    nothing = _acquisition(transmitted=np.ones((6, 8)), emitted=np.zeros((6, 8)))
    maps = evaluate_acquisition(nothing)
    assert maps.count() == {Reason.EMISSIVITY_TOO_LOW: 48}
    np.testing.assert_array_equal(maps.emissivity, 0.0)


def _weights(background: NDArray[Any]) -> Weights:
    zero = np.zeros(background.shape, np.float32)
    return Weights(background.astype(np.float32), zero, zero, zero.copy())


def _trace(spray: Weights, reference: Weights, kelvin: tuple[float, ...] = BACKGROUNDS) -> Maps:
    return evaluate_radiance(
        spray,
        reference,
        background_temperatures_K=kelvin,
        surroundings=Surroundings(wall_temperature_K=300.0, background_emissivity=0.9),
        filter_um=FILTER,
        sensor=None,
        shots=1,
        references=1,
    )


def test_trace_with_holes() -> None:
    """Nothing but NaN, nothing but wall, and an infinite weight are named, not propagated."""
    spray = _weights(np.array([[0.5, np.nan, 0.5, np.inf]]))
    spray.liquid[0, 0] = 0.5 * _radiance(400.0)
    reference = _weights(np.array([[1.0, 1.0, 0.0, 1.0]]))
    maps = _trace(spray, reference)
    few, hidden = Reason.TOO_FEW_BACKGROUNDS, Reason.BACKGROUND_NOT_VISIBLE
    np.testing.assert_array_equal(maps.reason, [[Reason.OK, few, hidden, few]])
    assert maps.apparent_temperature_K[0, 0] == pytest.approx(400.0, abs=1e-3)
    assert maps.emissivity[0, 0] == pytest.approx(0.5, rel=1e-6)


def test_trace_is_solved_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    spray = _weights(np.random.default_rng(1).random((13, 7)))
    whole = _trace(spray, _weights(np.ones((13, 7))))
    monkeypatch.setattr("cldit.dit.evaluate._BLOCK", 80)
    parts = _trace(spray, _weights(np.ones((13, 7))))
    np.testing.assert_array_equal(whole.emissivity, parts.emissivity)


def test_trace_refuses() -> None:
    ones = _weights(np.ones((2, 2)))
    with pytest.raises(EvaluationError, match="at least two"):
        _trace(ones, ones, (400.0,))
    with pytest.raises(EvaluationError, match="at least two"):
        _trace(ones, ones, (400.0, 400.0))
    with pytest.raises(EvaluationError, match="same radiance"):
        _trace(ones, ones, (0.0, 1.0))
    with pytest.raises(EvaluationError, match="without spray"):
        _trace(ones, _weights(np.ones((2, 3))))
