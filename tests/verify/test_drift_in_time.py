"""A drift goes on while a rig waits for its black body: time, not the number of the shot.

Set-up: as `test_drift`, with 10 to 100 intervals between the last shot before a background and the
first before the next. Expected: chi2 (variance about the truth over the stated one) is 1 with the
times of the shots, and far from it without. After a break of hours the camera's offset is another
number.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.dit.recorded import Evaluation, evaluate_shots
from tests.laboratory import Drifts, Laboratory, laboratory
from tests.verify.test_drift import chi2, mean_squares

SHOTS = 16
HOURS_s = 30_000.0
ACCEPT = (
    "backgrounds",
    "injections",
    "kinds",
)  # a creep over minutes of waiting may come to some kelvin


def _evaluated(made: Laboratory) -> Evaluation:
    return evaluate_shots(made.recorded, accept=ACCEPT)


def _waiting(seed: int, drifts: Drifts, *, timed: bool) -> Laboratory:
    waits = tuple(np.random.default_rng(seed).uniform(10.0, 100.0, 3))
    return laboratory(
        100 + seed,
        drifts=drifts,
        patch_pixels=1.5,
        shots=SHOTS,
        references=SHOTS,
        waits=waits,
        timed=timed,
    )


DRIFTS = [
    Drifts(),
    Drifts(offset_counts=0.02),  # hardly seen before one background, and 7 counts in all
    Drifts(offset_counts=1.0),
    Drifts(blackbody_K=0.1),
    Drifts(gain=-0.0001),
    Drifts(gain=0.0003, offset_counts=0.5, blackbody_K=0.1),
]


@pytest.mark.slow
@pytest.mark.parametrize("drifts", DRIFTS)
def test_errors_with_waits(drifts: Drifts) -> None:
    """Each drift alone, hardly seen and clear, and all three together."""
    waiting = [_waiting(seed, drifts, timed=True) for seed in range(500, 512)]
    kelvin, emissivity = chi2(waiting, ACCEPT)
    assert kelvin == pytest.approx(1.0, abs=0.1)
    assert emissivity == pytest.approx(1.0, abs=0.1)


def test_time_tells_what_the_number_of_the_shot_does_not() -> None:
    """Two seeds tell chi2 to 8 %, and an emissivity under drift, one number a seed, to a half."""
    drifts = Drifts(offset_counts=0.5, gain=0.0003)
    timed, untimed = (
        [_waiting(seed, drifts, timed=one) for seed in (500, 501)] for one in (True, False)
    )
    kelvin, emissivity = chi2(timed, ACCEPT)
    assert kelvin == pytest.approx(1.0, abs=0.25) and emissivity < 1.5
    assert max(chi2(untimed, ACCEPT)) > 3.0
    assert "drift fitted against time; median shot interval 2 s" in _evaluated(timed[0]).drift_axis
    assert "no shot has a time" in _evaluated(untimed[0]).drift_axis


def test_even_times_change_nothing() -> None:
    drifts = Drifts(offset_counts=1.0, gain=0.001)
    numbered, timed = (
        _evaluated(laboratory(1, drifts=drifts, timed=one)).maps for one in (False, True)
    )
    for name in ("apparent_temperature_K", "emissivity", "emissivity_standard_error"):
        np.testing.assert_array_equal(getattr(numbered, name), getattr(timed, name))


def _broken(seed: int, drifts: Drifts, *, after: int, counts: float) -> Laboratory:
    """A break of hours after so many shots; then the offset is another number."""
    made = laboratory(seed, drifts=drifts, patch_pixels=1.5, shots=SHOTS, references=SHOTS)
    shots = []
    for number, shot in enumerate(made.recorded.shots):
        later = number >= after
        image = np.clip(shot.image + (counts if later else 0.0), 0, 16383).astype(np.uint16)
        shots.append(replace(shot, image=image, time_s=2.0 * number + HOURS_s * later))
    made.recorded.shots = shots
    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("after", "offset_counts"), [(2 * SHOTS, 1.0), (4 * SHOTS, 0.0), (4 * SHOTS, 1.0)]
)
def test_a_drift_starts_anew_after_a_break(after: int, offset_counts: float) -> None:
    """Beyond one background, and between two and two."""
    drifts = Drifts(offset_counts=offset_counts)
    broken = [_broken(100 + seed, drifts, after=after, counts=40.0) for seed in range(500, 512)]
    kelvin, emissivity = chi2(broken, ACCEPT)
    assert kelvin == pytest.approx(1.0, abs=0.1)
    assert emissivity == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_a_break_within_a_background() -> None:
    """7 of 16 references are before it, and 6 of 16 injections: without that, T_app's chi2 is 1.25.
    12 seeds tell it to 3 %; the line over a pixel's shots leaves a part of the step as scatter."""
    drifts = Drifts(offset_counts=1.0)
    made = [_broken(100 + seed, drifts, after=45, counts=40.0) for seed in range(500, 512)]
    assert chi2(made, ACCEPT)[0] == pytest.approx(1.0, abs=0.15)


def test_a_break_is_said_and_an_offset_after_it_is_no_other_cause() -> None:
    made = _broken(1, Drifts(offset_counts=1.0), after=2 * SHOTS, counts=40.0)
    found = _evaluated(made)
    assert found.drift_axis.endswith("after a break (8.33 h) it restarts")
    squares = mean_squares(found, made)
    assert np.all(squares[:, 0] < 1.5 * squares[:, 1])
    steady = [one for one in found.drifts if one.name == "offset of the camera, steady drift"]
    assert len(steady) == 1


def test_a_drift_goes_on_through_a_break_where_the_references_show_it() -> None:
    """0.1 counts an interval, and as much in 1800 intervals without a shot: 180 counts."""
    made = _broken(2, Drifts(offset_counts=0.1), after=4 * SHOTS, counts=0.1 * 1802)
    made.recorded.shots = [
        replace(shot, time_s=(shot.time_s or 0.0) - (HOURS_s - 3604.0) * (number >= 4 * SHOTS))
        for number, shot in enumerate(made.recorded.shots)
    ]
    found = _evaluated(made)
    assert found.drift_axis.endswith("after a break (1 h) it continues, as the references show")
