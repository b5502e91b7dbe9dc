"""Images that are damaged in part, or of another depth or kind: named, and left out or refused.

Set-up: a laboratory's shots of a known spray (`tests/laboratory.py`) with one fault of the film.
Expected: the fault is named with its image; T_app and emissivity keep the errors of clean shots.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.dit.recorded import Evaluation, evaluate_shots
from cldit.errors import EvaluationError
from tests.laboratory import Drifts, Laboratory, laboratory
from tests.verify.evaluation_bias import Shot

SHAPE = (48, 64)
Counts = NDArray[Any]
Change = Callable[[Shot, dict[str, Counts]], Counts]


def _damaged(seed: int, change: Change, *, kinds: str = "reference injection") -> Laboratory:
    """Shots of which `change` makes the images, from all that were taken."""
    recording = laboratory(seed, shape=SHAPE)
    taken = {shot.id: shot.image for shot in recording.recorded.shots}
    recording.recorded.shots = [
        replace(shot, image=change(shot, taken)) if shot.kind in kinds else shot
        for shot in recording.recorded.shots
    ]
    return recording


def _errors(evaluation: Evaluation, recording: Laboratory) -> tuple[float, float]:
    """RMS errors of T_app, where the emissivity is above 0.2, and of the emissivity."""
    off = evaluation.maps.emissivity - recording.emissivity
    kelvin = (evaluation.maps.apparent_temperature_K - recording.kelvin)[recording.emissivity > 0.2]
    return float(np.sqrt(np.nanmean(kelvin**2))), float(np.sqrt(np.nanmean(off**2)))


@cache
def _clean(seed: int) -> tuple[float, float]:
    recording = laboratory(seed, shape=SHAPE)
    return _errors(evaluate_shots(recording.recorded), recording)


def _old_rows(shot: Shot, taken: dict[str, Counts]) -> Counts:
    """The first injection has odd rows of a reference."""
    if not shot.id.endswith("inj_00"):
        return shot.image
    image = shot.image.copy()
    image[1::2] = taken[shot.id.replace("inj_00", "ref_07")][1::2]
    return image


def _lost_lines(shot: Shot, _: dict[str, Counts]) -> Counts:
    """One injection and one reference lack packets."""
    image = shot.image.copy()
    if shot.id in ("b01_inj_02", "b02_ref_05"):
        image[20, :30] = image[21, 40:] = 0
    return image


def _ended(shot: Shot, _: dict[str, Counts]) -> Counts:
    """A file ends within an image and is filled with zeros."""
    image = shot.image.copy()
    if shot.id == "b03_inj_07":
        image[25:] = 0
    return image


def _spot(shot: Shot, _: dict[str, Counts]) -> Counts:
    """Something bright passes between spray and camera."""
    image = shot.image.copy()
    if shot.id in ("b00_inj_03", "b02_ref_01"):
        image[10:22, 20:34] += 2500
    return image


def _elsewhere(shot: Shot, taken: dict[str, Counts]) -> Counts:
    """The lower half of an image is that of another background."""
    image = shot.image.copy()
    if shot.id == "b01_inj_04":
        image[30:] = np.rint(1.002 * taken["b02_inj_04"][30:])
    return image


def _exposed(shot: Shot, _: dict[str, Counts]) -> Counts:
    """One reference and one injection are exposed for longer."""
    longer = shot.id in ("b01_ref_02", "b02_inj_06")
    return np.rint(shot.image * (1.3 if longer else 1.0)).astype(np.uint16)


def _salt(shot: Shot, _: dict[str, Counts]) -> Counts:
    """Some pixels of one reference are saturated."""
    image = shot.image.copy()
    if shot.id == "b03_ref_01":
        image[np.random.default_rng(0).random(SHAPE) < 0.02] = 16383
    return image


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_old_rows, [f"b0{k}_inj_00: half-old frame: rows 7, 9" for k in range(4)]),
        (
            _lost_lines,
            [f"{remark}: lost lines: rows 20, 21" for remark in ("b01_inj_02", "b02_ref_05")],
        ),
        (_ended, ["b03_inj_07: lost lines: rows 25 to 47 have one value"]),
        (_spot, ["b00_inj_03 is an outlier", "b02_ref_01 is an outlier"]),
        (_elsewhere, ["b01_inj_04 is an outlier"]),
        (_exposed, ["b01_ref_02 is an outlier", "b02_inj_06 is an outlier"]),
        (_salt, ["b03_ref_01 is an outlier"]),
    ],
)
def test_an_image_damaged_in_part_is_left_out(change: Change, named: list[str], seed: int) -> None:
    """Errors within 1.5 times those of clean shots: one shot less of eight alone gives 1.07."""
    recording = _damaged(seed, change)
    evaluation = evaluate_shots(recording.recorded)
    for finding in named:
        (line,) = (remark for remark in evaluation.remarks if finding in remark)
        assert line.endswith("; ignored")
    assert len(evaluation.remarks) == len(named)
    for error, clean in zip(_errors(evaluation, recording), _clean(seed), strict=True):
        assert error < 1.5 * clean


@pytest.mark.parametrize(
    ("change", "kinds", "message"),
    [
        (lambda shot, _: (shot.image // 64).astype(np.uint8), "injection",
         r"references have 16 bits \(first b03_ref_00\), injections have 8 bits"),
        (lambda shot, _: 4 * shot.image, "reference",
         r"references have counts in steps of 4 \(.*\), injections have counts in steps of 1"),
        (lambda shot, _: 2 * shot.image if shot.id == "b01_inj_03" else shot.image, "injection",
         r"1 images have counts in steps of 2 \(first b01_inj_03\)"),
    ],
)  # fmt: skip
def test_mixed_depths_are_refused(change: Change, kinds: str, message: str) -> None:
    with pytest.raises(EvaluationError, match=f"mixed depths: .*{message}"):
        evaluate_shots(_damaged(3, change, kinds=kinds).recorded)


@pytest.mark.parametrize("dropped", [5, 10])
def test_a_dropped_frame_in_turns_is_named(dropped: int) -> None:
    """A film with kinds in turns lacks one frame: from there on each is taken for the other."""
    recording = laboratory(4, shape=SHAPE)
    shots = {shot.id: shot for shot in recording.recorded.shots}
    recording.recorded.shots = []
    for background in range(4):
        names = [f"b0{background}_{kind}_0{n}" for n in range(8) for kind in ("ref", "inj")]
        taken = [name for number, name in enumerate(names) if number != dropped]
        recording.recorded.shots += [
            replace(shots[name], image=shots[image].image)
            for name, image in zip(names, taken, strict=False)
        ]
    with pytest.raises(EvaluationError, match="exchanged: a dropped frame in a film"):
        evaluate_shots(recording.recorded)


def test_most_images_damaged_are_refused() -> None:
    def change(shot: Shot, _: dict[str, Counts]) -> Counts:
        image = shot.image.copy()
        if shot.id.startswith("b01_ref"):
            image[10 + int(shot.id[-1])] = 0
        return image

    message = (
        r"references at 453 K: 8 of 8 images are damaged \(shot b01_ref_0.: lost lines: rows 1"
    )
    with pytest.raises(EvaluationError, match=message):
        evaluate_shots(_damaged(5, change).recorded)


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_image_lag_is_named(share: float) -> None:
    """Offset and gain drift as well, which is no lag."""
    drifts = Drifts(offset_counts=1.0, gain=2e-4)
    recording = laboratory(6, shape=SHAPE, scatter=0.0, drifts=drifts)
    previous = recording.recorded.shots[0].image
    for number, shot in enumerate(recording.recorded.shots):
        image = np.rint((1.0 - share) * shot.image + share * previous).astype(np.uint16)
        previous, recording.recorded.shots[number] = shot.image, replace(shot, image=image)
    findings = [
        witness.says
        for witness in evaluate_shots(recording.recorded).witnesses
        if "lag" in witness.says
    ]
    assert len(findings) == (share > 0.0)
    assert all(
        re.match(r"images contain 2(\.1)? % of the image before \(lag\)", x) for x in findings
    )
