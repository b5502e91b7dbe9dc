"""Traces and recorded shots without noise: maps, their reasons, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps, Reason
from cldit.dit.recorded import evaluate_shots
from cldit.errors import EvaluationError, RunFolderError
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from tests.verify.evaluation_bias import BACKGROUNDS_K, BARE, CAMERA, FILTER_UM, Recorded, Shot


def _radiance(kelvin: float) -> float:
    return float(band_radiance(kelvin, filter_um=FILTER_UM))


def _counts(radiance: Floats) -> NDArray[Any]:
    return np.rint(CAMERA.counts(radiance)).astype(np.uint16)


def _acquisition(*, transmitted: Floats, emitted: Floats, shots: int = 1) -> Recorded:
    """Without noise, but rounded to counts."""
    recorded: list[Shot] = []
    for kelvin in BACKGROUNDS_K:
        for kind in ("reference", "injection"):
            for number in range(shots):
                radiance = np.full(transmitted.shape, _radiance(kelvin))
                if kind == "injection":
                    radiance = radiance * transmitted + emitted
                name = f"{kelvin:g}-{kind}-{number}"
                recorded.append(Shot(name, kind, kelvin, kelvin, _counts(radiance)))
    return Recorded(recorded, BARE)


def _spray(shape: tuple[int, int] = (6, 8)) -> Recorded:
    transmitted = np.linspace(0.1, 0.9, shape[0] * shape[1]).reshape(shape)
    return _acquisition(transmitted=transmitted, emitted=(1 - transmitted) * _radiance(450.0))


def test_acquisition_without_noise() -> None:
    acquisition = _spray()
    seen: list[tuple[int, int]] = []
    maps = evaluate_shots(acquisition, progress=lambda *at: seen.append(at)).maps
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
            kelvin = shot.background_setpoint_K - 3.0
            image = _counts(np.full((6, 8), _radiance(kelvin)))
            acquisition.shots[index] = replace(shot, background_K=kelvin, image=image)
    maps = evaluate_shots(acquisition).maps
    expected = 1 - np.linspace(0.1, 0.9, 48).reshape(6, 8)
    np.testing.assert_allclose(maps.emissivity, expected, atol=5e-4)


def test_every_reason() -> None:
    acquisition = _spray()
    bad = np.zeros((6, 8), dtype=bool)
    bad[0, 0] = True
    acquisition.bad_pixels = bad
    calm = {s.background_K: s.image for s in acquisition.shots if s.kind == "reference"}
    dark = CAMERA.offset_counts
    for shot in acquisition.shots:
        image = shot.image
        image[0, 0] = 0
        image[0, 1] = 16383 if shot.background_setpoint_K > 400 else image[0, 1]
        image[0, 2] = 16383 if shot.background_setpoint_K > 500 else image[0, 2]
        image[1, 0] = dark + 9  # a wall, not the background
        if shot.kind == "injection":
            bare = calm[shot.background_K]
            image[1, 1] = bare[1, 1]
            image[1, 2] = np.rint((bare[1, 2] - dark) * 0.5) + dark - 60
    maps = evaluate_shots(acquisition).maps
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
    (shot,) = (shot for shot in acquisition.shots if shot.id == "560-injection-1")
    shot.image[0, 0] = 16383
    maps = evaluate_shots(acquisition, accept=["repeats"]).maps  # there is no noise in them
    assert maps.emissivity[0, 0] == pytest.approx(0.5, abs=2e-3)


def test_saved_and_loaded(tmp_path: Path) -> None:
    maps = evaluate_shots(_spray()).maps
    maps.save(tmp_path / "maps", pixel_m=(1e-4, 2e-4))
    back = Maps.load(tmp_path / "maps")
    for name in ("emissivity", "apparent_temperature_K", "reason", "reduced_chi2"):
        np.testing.assert_array_equal(getattr(back, name), getattr(maps, name))
    (tmp_path / "maps" / "reason.tif").unlink()
    with pytest.raises(RunFolderError, match=r"reason\.tif"):
        Maps.load(tmp_path / "maps")


def _drop(acquisition: Recorded, kind: str, setpoint: float) -> None:
    acquisition.shots = [
        s for s in acquisition.shots if (s.kind, s.background_setpoint_K) != (kind, setpoint)
    ]


def test_refuses_incomplete_recordings() -> None:
    single = _spray()
    single.shots = [s for s in single.shots if s.background_setpoint_K == 400]
    with pytest.raises(EvaluationError, match=r"\[400.0\] K; .* at least two"):
        evaluate_shots(single)
    empty = _spray()
    empty.shots = []
    with pytest.raises(EvaluationError, match="at least two"):
        evaluate_shots(empty)
    for kind in ("reference", "injection"):
        gap = _spray()
        _drop(gap, kind, 480.0)
        with pytest.raises(EvaluationError, match=f"background 480 K: no {kind}"):
            evaluate_shots(gap)


def test_refuses_bad_shots() -> None:
    still = _spray()
    still.shots = [replace(s, background_K=440.0) for s in still.shots]
    with pytest.raises(EvaluationError, match=r"\[440.0\] K"):
        evaluate_shots(still)
    cold = _spray()
    cold.shots = [replace(s, background_K=0.5 + s.background_setpoint_K / 1e3) for s in cold.shots]
    with pytest.raises(EvaluationError, match="the same radiance"):
        evaluate_shots(cold)
    lost = _spray()
    lost.shots[3] = replace(lost.shots[3], background_K=float("nan"))
    with pytest.raises(EvaluationError, match="440-injection-0: background at nan"):
        evaluate_shots(lost)
    odd = _spray()
    odd.shots[3] = replace(odd.shots[3], kind="dark")
    with pytest.raises(EvaluationError, match="440-injection-0: kind 'dark'"):
        evaluate_shots(odd)
    cut = _spray()
    cut.shots[3] = replace(cut.shots[3], image=cut.shots[3].image[:-1])
    with pytest.raises(EvaluationError, match=r"440-injection-0: image of shape \(5, 8\)"):
        evaluate_shots(cut)
    swapped = _spray()
    swapped.shots = [
        replace(s, kind="injection" if s.kind == "reference" else "reference")
        for s in swapped.shots
    ]
    with pytest.raises(EvaluationError, match="swapped"):
        evaluate_shots(swapped)


def test_an_empty_scene_is_no_swap() -> None:
    nothing = _acquisition(transmitted=np.ones((6, 8)), emitted=np.zeros((6, 8)))
    maps = evaluate_shots(nothing).maps
    assert maps.count() == {Reason.EMISSIVITY_TOO_LOW: 48}
    np.testing.assert_array_equal(maps.emissivity, 0.0)


def _weights(background: NDArray[Any]) -> Weights:
    zero = np.zeros(background.shape, np.float32)
    return Weights(background.astype(np.float32), zero, zero, zero.copy())


def _trace(spray: Weights, reference: Weights, kelvin: tuple[float, ...] = BACKGROUNDS_K) -> Maps:
    return evaluate_radiance(
        spray,
        reference,
        background_temperatures_K=kelvin,
        surroundings=Surroundings(wall_temperature_K=300.0, background_emissivity=0.9),
        filter_um=FILTER_UM,
        sensor=None,
        shots=1,
        references=1,
    )


def test_trace_with_holes() -> None:
    """Nothing but NaN, nothing but wall, and an infinite weight are named, not propagated."""
    spray = _weights(np.array([[0.5, np.nan, 0.5, np.inf]]))
    spray.liquid[0, 0] = 0.5 * float(band_radiance(400.0, filter_um=FILTER_UM))
    reference = _weights(np.array([[1.0, 1.0, 0.0, 1.0]]))
    maps = _trace(spray, reference)
    lacking, hidden = Reason.TOO_FEW_BACKGROUNDS, Reason.BACKGROUND_NOT_VISIBLE
    np.testing.assert_array_equal(maps.reason, [[Reason.OK, lacking, hidden, lacking]])
    assert maps.apparent_temperature_K[0, 0] == pytest.approx(400.0, abs=1e-3)
    assert maps.emissivity[0, 0] == pytest.approx(0.5, rel=1e-6)


def test_trace_is_solved_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    spray = _weights(np.random.default_rng(1).random((13, 7)))
    at_once = _trace(spray, _weights(np.ones((13, 7))))
    monkeypatch.setattr("cldit.dit.evaluate._BLOCK", 80)
    parts = _trace(spray, _weights(np.ones((13, 7))))
    np.testing.assert_array_equal(at_once.emissivity, parts.emissivity)


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
