"""Shots that do not belong to the others are named, and left out where that is asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.camera.photon_transfer import photon_transfer
from cldit.dit.recorded import evaluate_shots
from cldit.errors import EvaluationError
from tests.verify.evaluation_bias import CAMERA, TRUTH_K, record
from tests.verify.test_evaluation_bias import EMISSIVITY, _split


def test_a_misfire_is_named_and_left_out() -> None:
    """One of five injections did not fire: a fifth of the spray is missing before one background.

    Counted, it would lower an emissivity of 1 by some 5 % in the mean.
    """
    recorded = record(shots=5, side=16)
    shots = {shot.id: shot for shot in recorded.shots}
    others = {shot.id: shot for shot in record(shots=5, side=16, seed=6).shots}
    missed = "520-injection-2"
    recorded.shots[recorded.shots.index(shots[missed])] = replace(
        shots[missed], image=others["520-reference-2"].image
    )
    found = evaluate_shots(recorded)
    assert [shot.id for shot in found.outliers] == [missed]
    assert any(missed in line and line.endswith("ignored") for line in found.remarks)
    off = np.abs(_split(found.maps.emissivity).mean(axis=1) - EMISSIVITY)[-1]
    assert off < 0.002
    kelvin = _split(found.maps.apparent_temperature_K)[3:]
    assert np.all(np.abs(kelvin.mean(axis=1) - TRUTH_K) < 0.3)


@pytest.mark.parametrize("background", [400, 480, 560])
def test_kinds_swapped_before_one_background(background: int) -> None:
    recorded = record(shots=2, side=16)
    recorded.shots = [
        replace(shot, kind="injection" if shot.kind == "reference" else "reference")
        if shot.background_setpoint_K == background
        else shot
        for shot in recorded.shots
    ]
    with pytest.raises(EvaluationError, match=f"background {background} K.*swapped"):
        evaluate_shots(recorded)


def test_nan_and_text_are_refused() -> None:
    recorded = record(shots=1, side=4)
    image = recorded.shots[3].image.astype(np.float32)
    image[1, 2] = np.nan
    recorded.shots[3] = replace(recorded.shots[3], image=image)
    with pytest.raises(EvaluationError, match=r"440-injection-0: 1 pixels are not finite"):
        evaluate_shots(recorded)
    recorded.shots[3] = replace(recorded.shots[3], image=image > 0)
    with pytest.raises(EvaluationError, match="bool are no counts"):
        evaluate_shots(recorded)


def test_saturation_is_said() -> None:
    recorded = record(shots=2, side=8)
    for number, shot in enumerate(recorded.shots):
        if shot.background_setpoint_K == 560:
            recorded.shots[number] = replace(shot, image=np.full_like(shot.image, 16383))
    found = evaluate_shots(recorded)
    assert any(
        "560 K: 100 % of the pixels of its references are saturated; it is ignored" in line
        for line in found.remarks
    )
    assert np.isfinite(found.maps.emissivity).all()  # from the other four


@pytest.mark.parametrize("told_offset", [True, False])
def test_noise_and_gain_from_the_references(told_offset: bool) -> None:
    """Without a calibration but the filter: electrons a count to 3 %, and the same errors."""
    recorded = record(shots=20, side=24)
    whole = evaluate_shots(recorded)
    keep = {"filter_um", "saturation_counts"} | ({"offset_counts"} if told_offset else set())
    recorded.calibration = {key: CAMERA.to_dict()[key] for key in keep}
    found = evaluate_shots(recorded)
    # 13 824 pixels at 5 levels, 19 degrees each: a bin's median to 1 %
    assert found.calibration.electrons_per_count == pytest.approx(40.0, rel=0.03)
    if told_offset:
        assert found.calibration.read_noise_electrons == pytest.approx(200.0, rel=0.2)
        assert found.calibration.counts_per_radiance == pytest.approx(1.2e-17, rel=1e-3)
    for name in ("emissivity", "emissivity_standard_error"):
        got, expected = (np.nanmean(getattr(f.maps, name)) for f in (found, whole))
        assert got == pytest.approx(expected, rel=0.03)


def test_photon_transfer_needs_noise_that_rises() -> None:
    mean = np.linspace(1000.0, 5000.0, 500)
    with pytest.raises(EvaluationError, match="references that are equal"):
        photon_transfer(mean, np.zeros(500), exposures=5, offset_counts=None)
    with pytest.raises(EvaluationError, match="does not rise"):
        photon_transfer(mean, 1e3 - 0.1 * mean, exposures=5, offset_counts=None)
    single = record(shots=1, side=4)
    single.calibration = {k: CAMERA.to_dict()[k] for k in ("filter_um", "saturation_counts")}
    with pytest.raises(EvaluationError, match="one reference per background"):
        evaluate_shots(single)
