"""Shots that contradict the measurement equation are named; clean ones are left alone.

Set-up: a laboratory's shots of a known spray (`tests/laboratory.py`), clean or with one fault.
Expected: the witness names the background, ends the evaluation where the fault is large, and
otherwise the stated errors cover what it does to T_app.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.dit.recorded import Evaluation, evaluate_shots
from cldit.errors import EvaluationError
from tests.laboratory import BACKGROUNDS_K, Drifts, Laboratory, laboratory
from tests.verify.evaluation_bias import Shot

SMALL = (24, 40)


def _witness(found: Evaluation, name: str) -> Any:
    (one,) = (witness for witness in found.witnesses if witness.name == name)
    return one


def _edit(made: Laboratory, change: Callable[[Shot], Shot]) -> Laboratory:
    made.recorded.shots = [change(shot) for shot in made.recorded.shots]
    return made


def _ratio(found: Evaluation, made: Laboratory) -> float:
    """RMS error of T_app over the stated one, in the pixels with an emissivity above 0.15."""
    kelvin = found.maps.apparent_temperature_K.astype(float)
    known = np.isfinite(kelvin) & (made.emissivity > 0.15)
    stated = found.maps.apparent_temperature_standard_error_K[known].astype(float)
    off = (kelvin - made.kelvin)[known]
    return float(np.sqrt(np.mean(off**2) / np.mean(stated**2)))


def _clean(seed: int) -> list[str]:
    """What the witnesses say of a clean recording; each seed has another set-up."""
    rng = np.random.default_rng(seed)
    made = laboratory(
        seed,
        shape=((24, 40), (48, 64), (33, 20))[seed % 3],
        references=int(rng.integers(2, 9)),
        shots=int(rng.integers(2, 9)),
        scatter=float(rng.choice([0.0, 0.02, 0.05, 0.1])),
        interleave=bool(seed % 2),
        plume=bool(seed % 7),
        backgrounds_K=(
            BACKGROUNDS_K,
            (423.0, 463.0, 523.0),
            (423.0, 443.0, 463.0, 483.0, 523.0),
            (430.0, 500.0),
        )[seed % 4],
    )
    found = evaluate_shots(made.recorded)
    return [f"{seed}: {one.text}" for one in found.witnesses if one.stands_out]


def test_no_false_alarm() -> None:
    assert [line for seed in range(8) for line in _clean(seed)] == []


@pytest.mark.parametrize("plume", [True, False])
@pytest.mark.parametrize(("references", "shots"), [(1, 1), (1, 3), (2, 1)])
def test_single_shots_are_no_alarm(references: int, shots: int, plume: bool) -> None:
    """Nothing tells how single shots scatter but the camera's noise; without scatter it is all."""
    for seed in range(2):
        made = laboratory(
            seed, shape=SMALL, references=references, shots=shots, plume=plume, scatter=0.0
        )
        assert not any(one.stands_out for one in evaluate_shots(made.recorded).witnesses)


@pytest.mark.slow
def test_no_false_alarm_of_any_set_up() -> None:
    """84 seeds, after those above, have each combination of shape, order, plume and backgrounds
    (3, 2, 7 and 4 of them) once. 3.5 % of false alarms would show with a probability of 95 %."""
    assert [line for seed in range(8, 92) for line in _clean(seed)] == []


@pytest.mark.parametrize(
    ("background_K", "off_K", "seed"), [(483.0, 1.0, 1), (423.0, 1.0, 2), (523.0, -1.0, 3)]
)
def test_a_black_body_that_is_off_is_named(background_K: float, off_K: float, seed: int) -> None:
    made = laboratory(seed, off_K={background_K: off_K})
    found = evaluate_shots(made.recorded)
    witness = _witness(found, "backgrounds")
    assert witness.stands_out and not witness.severe
    assert f"background {background_K:g} K deviates by {off_K:+.1f}" in witness.text
    at = BACKGROUNDS_K.index(background_K)
    assert witness.kelvin[at] == pytest.approx(off_K, abs=0.05)
    # The other three backgrounds carry the result. Scatter is common to all pixels, so the ratio
    # of one picture wavers: 1.5 is 2 of its standard deviations, and without widening it is 4.
    assert _ratio(found, made) < 1.5
    with pytest.raises(EvaluationError, match=f"background {background_K:g} K.*no other filter"):
        evaluate_shots(made.recorded, curve="fitted")


def test_three_backgrounds_do_not_tell_which_is_off() -> None:
    made = laboratory(4, backgrounds_K=(423.0, 463.0, 523.0), off_K={463.0: 1.0})
    found = evaluate_shots(made.recorded)
    assert "one of the three deviates" in _witness(found, "backgrounds").text


@pytest.mark.parametrize(
    ("pair", "kinds", "name"),
    [
        ((423.0, 453.0), ("reference",), "references"),
        ((453.0, 523.0), ("reference", "injection"), "references"),
        ((423.0, 523.0), ("injection",), "injections"),
    ],
)
def test_swapped_backgrounds_are_refused(
    pair: tuple[float, float], kinds: tuple[str, ...], name: str
) -> None:
    other = dict(zip(pair, pair[::-1], strict=True))

    def change(shot: Shot) -> Shot:
        at = other.get(shot.background_K, shot.background_K)
        if shot.kind not in kinds:
            return shot
        return replace(shot, background_setpoint_K=at, background_K=at)

    made = _edit(laboratory(5, shape=SMALL), change)
    names = f"{pair[0]:g} K and {pair[1]:g} K look swapped"
    with pytest.raises(EvaluationError, match=rf"the {name} .*{names}"):
        evaluate_shots(made.recorded)


def test_degrees_celsius_are_refused() -> None:
    def change(shot: Shot) -> Shot:
        at = shot.background_K - 273.15 * part
        return replace(shot, background_setpoint_K=at, background_K=at)

    part = 1.0
    with pytest.raises(EvaluationError, match=r"look like degrees Celsius: background 149\.85"):
        evaluate_shots(_edit(laboratory(6, shape=SMALL), change).recorded)
    warm = laboratory(6, shape=SMALL, backgrounds_K=(503.0, 518.0, 533.0, 548.0))
    with pytest.raises(EvaluationError, match=r"they fit with 273\.15 added"):
        evaluate_shots(_edit(warm, change).recorded)


@pytest.mark.parametrize("offset_counts", [-20.0, 10.0])
def test_an_offset_between_the_kinds_is_named(offset_counts: float) -> None:
    made = laboratory(7, offset_of_injections=offset_counts)
    found = evaluate_shots(made.recorded)
    witness = _witness(found, "kinds")
    assert witness.stands_out and not witness.severe
    assert "the camera's offset changed between the kinds" in witness.text
    assert np.all(np.sign(witness.kelvin) == np.sign(offset_counts))
    # The fault itself, the same in all pixels, is stated as one standard error.
    assert 0.7 < _ratio(found, made) < 1.4


@pytest.mark.parametrize("apart_K", [-0.5, 1.0])
def test_a_black_body_between_the_kinds_is_named(apart_K: float) -> None:
    made = laboratory(8, blackbody_of_injections_K=apart_K)
    found = evaluate_shots(made.recorded)
    witness = _witness(found, "kinds")
    assert witness.stands_out and "the black body differed by" in witness.text
    np.testing.assert_allclose(witness.kelvin, apart_K, atol=0.05)
    assert 0.6 < _ratio(found, made) < 1.4


def test_a_black_body_whose_readings_follow_it_is_no_alarm() -> None:
    """Injections in front of a black body that is 1 K warmer, and is read so."""

    def change(shot: Shot) -> Shot:
        warmer = 1.0 if shot.kind == "injection" else 0.0
        return replace(shot, background_K=shot.background_K + warmer)

    made = laboratory(8, shape=SMALL, blackbody_of_injections_K=1.0)
    assert not _witness(evaluate_shots(_edit(made, change).recorded), "kinds").stands_out


def test_kelvins_between_the_kinds_are_refused_unless_accepted() -> None:
    made = laboratory(9, shape=SMALL, blackbody_of_injections_K=5.0)
    with pytest.raises(EvaluationError, match=r"accept: \[kinds\]"):
        evaluate_shots(made.recorded)
    assert _witness(evaluate_shots(made.recorded, accept=["kinds"]), "kinds").severe
    with pytest.raises(EvaluationError, match="accept: kindz; allowed: backgrounds"):
        evaluate_shots(made.recorded, accept=["kindz"])


def _columns(image: NDArray[Any]) -> NDArray[Any]:
    return np.roll(image, 1, axis=1)


@pytest.mark.parametrize(
    ("turn", "kind", "background_K", "text"),
    [
        (np.fliplr, "injection", 453.0, "injections at 453 K are mirrored left to right"),
        (np.flipud, "reference", 523.0, "references at 523 K are upside down"),
        (np.rot90, "injection", 483.0, "turned by"),
        (_columns, "injection", 453.0, r"injections at 453 K are shifted by \+1 columns"),
        (_columns, "reference", 423.0, r"references at 423 K are shifted by \+1 columns"),
    ],
)
def test_pictures_that_lie_otherwise_are_refused(
    turn: Callable[[NDArray[Any]], NDArray[Any]],
    kind: str,
    background_K: float | None,
    text: str,
) -> None:
    def change(shot: Shot) -> Shot:
        if shot.kind != kind or background_K not in (None, shot.background_K):
            return shot
        return replace(shot, image=np.ascontiguousarray(turn(shot.image)))

    made = _edit(laboratory(10, shape=(32, 32)), change)
    with pytest.raises(EvaluationError, match=text):
        evaluate_shots(made.recorded)


@pytest.mark.parametrize(("background_K", "moved"), [(483.0, (0, -1)), (523.0, (1, 1))])
def test_a_spray_that_the_camera_sees_elsewhere_is_named(
    background_K: float, moved: tuple[int, int]
) -> None:
    """The camera was moved: the pixels' pattern stays, the spray does not."""
    made = laboratory(11, spray_shift={background_K: moved}, scatter=0.02)
    witness = _witness(evaluate_shots(made.recorded), "shift")
    assert witness.stands_out
    assert f"background {background_K:g} K: the spray is shifted" in witness.text


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("b00_ref_00", "b00_ref_01"),
        ("b01_inj_00", "b01_inj_03"),
        ("b00_ref_00", "b02_ref_00"),
    ],
)
def test_repeats_are_excluded(source: str, target: str) -> None:
    """Of one group the first image is good; of two groups it is not known which."""
    made = laboratory(12, shape=SMALL)
    images = {shot.id: shot.image for shot in made.recorded.shots}

    def change(shot: Shot) -> Shot:
        return replace(shot, image=images[source]) if shot.id == target else shot

    _edit(made, change)
    found = evaluate_shots(made.recorded)
    wrong = {target: source} | ({source: target} if source[:3] != target[:3] else {})
    named = [line for line in found.remarks if "repeats" in line]
    assert sorted(named) == sorted(
        f"shot {name}: repeats {other}: a frozen camera, or a copied file; ignored"
        for name, other in wrong.items()
    )


def test_a_group_that_repeats_in_half_is_refused() -> None:
    made = laboratory(12, shape=SMALL)
    first = made.recorded.shots[0]

    def change(shot: Shot) -> Shot:
        same = (shot.kind, shot.background_K) == (first.kind, first.background_K)
        return replace(shot, image=first.image) if same else shot

    _edit(made, change)
    with pytest.raises(EvaluationError, match=r"images are damaged .*repeats .*record them again"):
        evaluate_shots(made.recorded)


def test_accepted_repeats_count_once() -> None:
    """A camera that froze after the second of eight shots tells as much as two."""
    made = laboratory(13, shape=SMALL, scatter=0.0)
    images = {shot.id: shot.image for shot in made.recorded.shots}

    def change(shot: Shot) -> Shot:
        return replace(shot, image=images[shot.id[:-2] + f"{min(int(shot.id[-2:]), 1):02d}"])

    frozen = evaluate_shots(_edit(made, change).recorded, accept=["repeats"])
    whole = evaluate_shots(laboratory(13, shape=SMALL, scatter=0.0, references=2, shots=2).recorded)
    errors = [
        float(np.nanmedian(found.maps.emissivity_standard_error)) for found in (frozen, whole)
    ]
    # (sum w)^2 / sum w^2 of weights 1 and 7 is 1.28, not 2: at most sqrt(2 / 1.28) apart.
    assert errors[1] < errors[0] < 1.5 * errors[1]


@pytest.mark.parametrize("share", [0.8, 0.95])
def test_a_camera_that_ends_early_is_named(share: float) -> None:
    made = laboratory(14)
    level = int(share * max(float(shot.image.max()) for shot in made.recorded.shots))
    kelvin = evaluate_shots(made.recorded).maps.apparent_temperature_K

    def change(shot: Shot) -> Shot:
        return replace(shot, image=np.minimum(shot.image, level))

    found = evaluate_shots(_edit(made, change).recorded)
    witness = _witness(found, "saturation")
    assert f"523 K end at {level} counts" in witness.text
    # The other backgrounds carry the pixels that are full; unnoticed it would be tens of kelvins.
    dense = np.isfinite(kelvin) & (made.emissivity > 0.4)
    after = found.maps.apparent_temperature_K
    assert np.nanmedian(np.abs(after - kelvin)[dense]) < 1.0


def test_frames_along_an_axis_are_refused() -> None:
    """(rows, columns, frames) read as (frames, rows, columns): each row becomes a picture."""
    made = laboratory(15, shape=(12, 16), references=16, shots=16, scatter=0.0)
    shots: list[Shot] = []
    for background_K in BACKGROUNDS_K:
        for kind in ("reference", "injection"):
            group = [
                shot
                for shot in made.recorded.shots
                if (shot.kind, shot.background_K) == (kind, background_K)
            ]
            stack = np.stack([shot.image for shot in group], axis=-1)  # rows, columns, frames
            shots += [replace(shot, image=image) for shot, image in zip(group, stack, strict=False)]
    made.recorded.shots = shots
    with pytest.raises(EvaluationError, match="along their columns: are frames stored"):
        evaluate_shots(made.recorded)


def test_improbable_pixels_are_counted() -> None:
    clean = evaluate_shots(laboratory(16, scatter=0.0).recorded)
    assert clean.improbable < 0.01 and any("fit_probability below 0.001" in x for x in clean.lines)
    moved = _edit(
        laboratory(16, scatter=0.0),
        lambda shot: replace(shot, image=_columns(shot.image)) if "b01_inj" in shot.id else shot,
    )
    found = evaluate_shots(moved.recorded, accept=["orientation", "shift"])
    assert found.improbable < 0.01 and any(one.name == "pixels" for one in found.witnesses)


def test_drift_that_drops_out_is_harmless() -> None:
    """A creep of 0.2 counts a shot, interleaved, is no alarm between the kinds."""
    found = evaluate_shots(laboratory(17, drifts=Drifts(offset_counts=0.2)).recorded)
    assert not _witness(found, "kinds").stands_out
