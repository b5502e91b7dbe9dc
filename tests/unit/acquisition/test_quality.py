"""Choice of shots: an injection without fuel is found by its image, and by nothing less.

Images are drawn as the camera's noise says, so that the chance of a wrong answer is known: of
some 900 pixels one in 1.7 million stands out by 5 standard deviations, two are allowed by nobody.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.acquisition.plan import Plan, Shot
from cldit.acquisition.preflight import Ready
from cldit.acquisition.quality import References, frame_problem, saturated_percent
from cldit.camera.calibration import Calibration
from cldit.optics.planck import band_radiance
from cldit.rig.protocols import Frame, TriggerInfo, TriggerMode

CAMERA = Calibration(
    filter_um=(3.3, 3.5),
    counts_per_radiance=2e-16,
    offset_counts=1000.0,
    electrons_per_count=40.0,
    read_noise_electrons=200.0,
    saturation_counts=16383.0,
)
SHAPE = (128, 160)
READY = Ready(
    configuration={}, shape=SHAPE, integration_time_s=25e-6, saturation_counts=16383,
    minimum_period_s=0.0, trigger=TriggerInfo(TriggerMode.EXTERNAL_EDGE), picture_bytes=0,
    calibrations=(CAMERA,),
)  # fmt: skip
KELVIN = 440.0
REFERENCE = Shot("b00_ref_00", 0, KELVIN, "reference", 0)
INJECTION = Shot("b00_inj_00", 0, KELVIN, "injection", 0)


def disc() -> NDArray[np.bool_]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    inside: NDArray[np.bool_] = (x - 80) ** 2 + (y - 64) ** 2 < 50**2
    return inside


def picture(seed: int, *, drift_K: float = 0.0, depth: float = 0.0) -> NDArray[np.uint16]:
    """A disc at 440 K before walls at 380 K; a plume of this optical depth, some 20 pixels wide."""
    rng = np.random.default_rng(seed)
    hot, wall = (float(band_radiance(k, filter_um=(3.3, 3.5))) for k in (KELVIN + drift_K, 380.0))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    through = np.exp(-depth * np.exp(-((x - 80) ** 2 + (y - 60) ** 2) / 10.0**2))
    signal = CAMERA.counts_per_radiance * np.where(disc(), hot, wall) * through
    electrons = rng.poisson(signal * CAMERA.electrons_per_count) + rng.normal(0.0, 200.0, SHAPE)
    counts = np.rint(CAMERA.offset_counts + electrons / CAMERA.electrons_per_count)
    return np.asarray(np.clip(counts, 0, 16383), np.uint16)


def references(**plan: Any) -> References:
    settings = {"backgrounds_K": [KELVIN], "drift_K": 0.5, **plan}
    made = References(Plan.model_validate(settings), READY)
    for seed in range(3):
        made.learn(REFERENCE, picture(seed))
    return made


@pytest.mark.parametrize("drift_K", [0.0, 0.2, -0.2])
def test_no_fuel_is_found(drift_K: float) -> None:
    """In each of ten shots, also where the black body drifted between reference and shot."""
    known = references()
    for seed in range(10, 20):
        problem = known.problem(INJECTION, picture(seed, drift_K=drift_K))
        assert problem is not None and problem.startswith("failed injection")


@pytest.mark.parametrize("depth", [0.03, 0.1, 2.0])
def test_fuel_is_fuel(depth: float) -> None:
    """Three percent of absorption in a plume of 20 pixels are enough."""
    known = references()
    for seed in range(10, 15):
        assert known.problem(INJECTION, picture(seed, depth=depth)) is None


def test_more_than_a_drift_is_no_failed_injection() -> None:
    """A cloud over the whole disc looks like a colder disc: 3 K are more than drift_K explains."""
    assert references().problem(INJECTION, picture(10, drift_K=-3.0)) is None


def test_noise_that_the_calibration_does_not_know_rejects_nothing() -> None:
    rng = np.random.default_rng(1)
    noisy = picture(10) + rng.normal(0.0, 300.0, SHAPE)
    assert references().problem(INJECTION, np.clip(noisy, 0, 16383).astype(np.uint16)) is None


def test_what_is_not_judged() -> None:
    known, still = references(), picture(10)
    assert known.problem(REFERENCE, still) is None
    assert known.problem(replace(INJECTION, background=1), still) is None  # no reference there
    assert references(expect_fuel=False).problem(INJECTION, still) is None


def test_several_frames() -> None:
    """Fuel in one frame of a shot is fuel."""
    known = references()
    still = np.stack([picture(seed) for seed in range(10, 13)])
    assert known.problem(INJECTION, still) is not None
    still[1] = picture(20, depth=0.2)
    assert known.problem(INJECTION, still) is None


def test_saturated_pictures_do_not_differ() -> None:
    full = np.full(SHAPE, 16383, np.uint16)
    known = References(Plan.model_validate({"backgrounds_K": [KELVIN]}), READY)
    known.learn(REFERENCE, full)
    assert known.problem(INJECTION, full) is not None
    assert saturated_percent(full, 16383) == 100.0
    assert saturated_percent(np.stack([full, 0 * full]), 16383) == 100.0


def test_frames_of_a_shot_are_in_order() -> None:
    first, second = (Frame(picture(n), 7 + n, 0, 0) for n in range(2))
    assert frame_problem([first, second], READY, expected_id=7) is None
    assert frame_problem([first, second], READY) is None
    gap = frame_problem([first, replace(second, frame_id=9)], READY)
    assert gap == "missing frame: frame 9 came in place of 8"
    assert "in place of 6" in (frame_problem([first], READY, expected_id=6) or "")
    dead = replace(first, data=np.zeros(SHAPE, np.uint16))
    assert "dead frame" in (frame_problem([dead], READY) or "")
