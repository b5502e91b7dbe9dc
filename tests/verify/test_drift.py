"""A camera or a black body that drifts, and plans that interleave references and injections.

Set-up: a known spray, recorded while the camera's offset creeps by 1 count a shot, its gain by
0.1 % a shot, and the black body by 0.1 K a minute. Expected: an offset drops out of T_app, as it
does of the paper's Delta I; the rest is in the stated errors; chi2 (variance about the truth over
the stated one) is 1 with noise, scatter and drift together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.dit.recorded import Evaluation, evaluate_shots
from tests.laboratory import AROUND, Drifts, Laboratory, laboratory

BANDS = ((0.1, 0.2), (0.2, 0.4), (0.4, 0.85))  # of emissivity
CREEP = Drifts(offset_counts=1.0)


def _evaluated(made: Laboratory, accept: Sequence[str] = ()) -> Evaluation:
    return evaluate_shots(made.recorded, accept=accept)


def mean_squares(found: Evaluation, made: Laboratory) -> Floats:
    """(bands, 4) mean squares: error of T_app and the stated one, of the emissivity likewise."""
    maps = found.maps
    kelvin = maps.apparent_temperature_K.astype(float)
    rows = []
    for low, high in BANDS:
        here = np.isfinite(kelvin) & (made.emissivity > low) & (made.emissivity < high)
        rows.append(
            [
                float(np.mean(one[here].astype(float) ** 2))
                for one in (
                    kelvin - made.kelvin,
                    maps.apparent_temperature_standard_error_K,
                    maps.emissivity - made.emissivity,
                    maps.emissivity_standard_error,
                )
            ]
        )
    return np.array(rows)


def chi2(recorded: Iterable[Laboratory], accept: Sequence[str] = ()) -> tuple[float, float]:
    """Of T_app and of the emissivity, means over the bands."""
    total = np.mean([mean_squares(_evaluated(one, accept), one) for one in recorded], axis=0)
    return float(np.mean(total[:, 0] / total[:, 1])), float(np.mean(total[:, 2] / total[:, 3]))


def drifting(seeds: Iterable[int], drifts: Drifts) -> Iterator[Laboratory]:
    """Recordings with scatter in patches of some pixels, so that one image has many of them."""
    for seed in seeds:
        yield laboratory(100 + seed, drifts=drifts, patch_pixels=1.5, shots=16, references=16)


@pytest.mark.slow
@pytest.mark.parametrize(
    "drifts", [Drifts(), Drifts(offset_counts=1.0, gain=0.001, blackbody_K=0.1)]
)
def test_errors_with_noise_scatter_and_drift(drifts: Drifts) -> None:
    """48 seeds tell chi2 to 1.5 %; 12 of them to 3 %, and T_app's is 0.93 to 0.99 (scatter between
    shots is never found below zero), so 12 would leave 0.9 to 1.1 by chance. Each drift alone is
    in `test_drift_in_time`."""
    kelvin, emissivity = chi2(drifting(range(500, 548), drifts))
    assert kelvin == pytest.approx(1.0, abs=0.1)
    assert emissivity == pytest.approx(1.0, abs=0.1)


def test_errors_with_noise_scatter_and_drift_of_two_seeds() -> None:
    """As the slow test; two seeds tell chi2 to 8 %."""
    drifts = Drifts(offset_counts=1.0, gain=0.001, blackbody_K=0.1)
    kelvin, emissivity = chi2(drifting(range(2), drifts))
    assert kelvin == pytest.approx(1.0, abs=0.2)
    assert emissivity == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_offset_that_creeps_drops_out(seed: int) -> None:
    """The same shots with and without a creep of 1 count: T_app does not move.

    Rounding to counts is the only other difference: 0.3 counts over sqrt(8), some 0.02 K where
    the noise is 1 K; the medians of a hundred pixels are good to a tenth of the stated error.
    """
    still, creeping = (laboratory(seed, drifts=drifts, scatter=0.0) for drifts in (Drifts(), CREEP))
    kelvin = [_evaluated(made).maps.apparent_temperature_K for made in (still, creeping)]
    for low, high in ((0.1, 0.3), (0.3, 0.6), (0.6, 1.0)):
        here = (still.emissivity > low) & (still.emissivity < high)
        assert abs(float(np.nanmedian((kelvin[1] - kelvin[0])[here]))) < 0.1


def test_the_emissivity_states_what_the_creep_does() -> None:
    """What an offset adds in proportion to the background is gain to a line: 64 counts creep over
    the set points, 1 % of the lines' slope. How far their curvature tells the creep from a slope is
    in the error, which grows by less than that."""
    made = laboratory(4, drifts=CREEP, scatter=0.0)
    squares = mean_squares(_evaluated(made), made)
    assert np.all(squares[:, 2] < 1.5 * squares[:, 3])
    still = mean_squares(_evaluated(same := laboratory(4, scatter=0.0)), same)
    assert 1.5 * still[-1, 3] < squares[-1, 3] < 0.01**2


def test_a_gain_that_creeps_is_in_the_errors() -> None:
    """0.1 % a shot come to 6 %; a picture of this size tells chi2 to 20 %."""
    made = laboratory(5, drifts=Drifts(gain=0.001))
    found = _evaluated(made)
    squares = mean_squares(found, made)
    assert np.all(squares[:, 0] < 1.5 * squares[:, 1])
    assert np.all(squares[:, 2] < 1.5 * squares[:, 3])
    assert any("as if the camera's gain changed" in one.text for one in found.witnesses)


def test_a_black_body_that_drifts_is_in_the_errors() -> None:
    """1 K a minute without scatter: some hundred pixels tell chi2 to 14 %, and two of these are
    allowed. Without the drift itself in the errors it is 1.5 where the spray is dense."""
    made = laboratory(10, drifts=Drifts(blackbody_K=1.0), shape=(24, 40), scatter=0.0)
    found = _evaluated(made)
    assert [drift.name for drift in found.drifts] == ["black body, steady drift"]
    squares = mean_squares(found, made)
    assert np.all(squares[:, 0] < 1.28 * squares[:, 1])


def test_blocks_are_told_from_interleaved_shots() -> None:
    """All references first: the creep stands between the kinds, and is stated."""
    made = laboratory(6, drifts=CREEP, interleave=False)
    found = _evaluated(made)
    (kinds,) = (one for one in found.witnesses if one.name == "kinds")
    assert kinds.stands_out
    squares = mean_squares(found, made)
    assert np.all(squares[:, 0] < 1.5 * squares[:, 1])
    interleaved = laboratory(6, drifts=CREEP)
    assert np.all(mean_squares(_evaluated(interleaved), interleaved)[:, 0] < 0.3 * squares[:, 0])


def test_a_stated_offset_is_in_the_covariance() -> None:
    """`setup.camera_offset_error_counts` alone: references may lie off their line by as much."""
    made = laboratory(7, drifts=Drifts(offset_counts=0.3), scatter=0.0)
    made.recorded.surroundings = replace(AROUND, camera_offset_error_counts=30.0)
    found = _evaluated(made)
    assert not any(one.stands_out for one in found.witnesses)
    squares = mean_squares(found, made)
    assert np.all(squares[:, 0] < 1.6 * squares[:, 1])
