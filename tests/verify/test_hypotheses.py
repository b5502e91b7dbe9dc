"""Planted faults of a measurement are named by the cause that was planted.

Set-up: recordings of `tests/verify/test_independent_model.py` with one fault each. Expected: at
least nine of ten are named, as the best of the fitted causes.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.dit.recorded import evaluate_shots
from cldit.errors import EvaluationError
from tests.verify.evaluation_bias import Shot
from tests.verify.test_independent_model import Made, made

ICE = 273.15


def _stated(to_stated: Callable[[float], float]) -> Callable[[Shot, Any], Shot]:
    """Other temperatures are stated than those of the black body."""

    def change(shot: Shot, _: Any) -> Shot:
        at = to_stated(shot.background_K)
        return replace(shot, background_K=at, background_setpoint_K=at)

    return change


def _seen(edit: Callable[[Shot, Floats], Any]) -> Callable[[Shot, Any], Shot]:
    """Other counts of each image."""

    def change(shot: Shot, _: Any) -> Shot:
        counts = np.rint(edit(shot, shot.image.astype(float)))
        return replace(shot, image=np.clip(counts, 0, 16383).astype(np.uint16))

    return change


def _injections(edit: Callable[[Floats], Any]) -> Callable[[Shot, Any], Shot]:
    return _seen(lambda shot, image: edit(image) if shot.kind == "injection" else image)


def _background(number: int) -> float:
    return float(np.linspace(423.0, 523.0, 4)[number])


def _off(number: int, kelvin: float) -> Callable[[Shot, Any], Shot]:
    """The temperature of one background is stated too low by so many kelvin."""
    return _stated(lambda at: at - kelvin * (at == _background(number)))


def _pattern(image: Floats, size: float, *, gain: bool) -> Floats:
    pattern = size * np.random.default_rng(1).standard_normal(image.shape)
    return image * (1.0 + pattern) if gain else image + pattern


def _renewed(size: float, *, gain: bool) -> Callable[[Shot, Any], Shot]:
    return _injections(lambda image: _pattern(image, size, gain=gain))


def _renewed_from(number: int, size: float, *, gain: bool) -> Callable[[Shot, Any], Shot]:
    """Of images of both kinds, from one background on."""
    first_K = _background(number) - 1.0
    return _seen(
        lambda shot, image: (
            _pattern(image, size, gain=gain) if shot.background_K > first_K else image
        )
    )


def _swap(at: float) -> float:
    pair = {_background(1): _background(2), _background(2): _background(1)}
    return pair.get(at, at)


FAULTS: dict[str, tuple[Callable[[Shot, Any], Shot], str]] = {
    "F as C": (_stated(lambda at: 1.8 * (at - ICE) + 32.0 + ICE),
               "look like degrees F that were taken for degrees Celsius"),
    "F as K": (_stated(lambda at: 1.8 * (at - ICE) + 32.0), "degrees F that were taken for K"),
    "C as F": (_stated(lambda at: (at - ICE - 32.0) / 1.8 + ICE),
               "degrees Celsius that were taken for degrees F"),
    "K as C": (_stated(lambda at: at + ICE), "K that were taken for degrees Celsius"),
    "C as K": (_stated(lambda at: at - ICE), "look like degrees Celsius"),
    "swapped": (_stated(_swap), r"backgrounds 456.* and 489.* look swapped"),
    "one +1 K": (_off(1, 1.0), r"background 455.* K deviates by \+1"),
    "one -0.5 K": (_off(2, -0.5), r"background 490.* K deviates by -0.5"),
    "last +2 K": (_off(3, 2.0), r"background 521 K deviates by \+(2|1\.9)"),
    "bent by 3 %": (_seen(lambda _, image: image * (1.0 - 0.03 * image / 16383.0)),
                    "the filter, or the camera's curve, differs"),
    "exposure": (_seen(lambda shot, image: image * (1.02 if shot.background_K > 470.0 else 1.0)),
                 r"gain \(exposure, range\) changed from 489.* on"),
    "offset +20": (_injections(lambda image: image + 20.0), "camera's offset changed between"),
    "offset -15": (_injections(lambda image: image - 15.0), "camera's offset changed between"),
    "gain +1 %": (_injections(lambda image: 300.0 + 1.01 * (image - 300.0)),
                  r"gain \(exposure, range\) changed by \+(1|0\.99) % between"),
    "gain -2 %": (_injections(lambda image: 300.0 + 0.98 * (image - 300.0)),
                  "no pixel is free of spray .* or a lower gain, is not seen"),
    "half exposure": (_injections(lambda image: 300.0 + 0.5 * (image - 300.0)),
                      "no pixel is free of spray .* or a lower gain, is not seen"),
    "gamma": (_injections(lambda image: 16383.0 * (image / 16383.0) ** 0.97), "curve|gamma"),
    "offsets renewed": (_renewed(15.0, gain=False),
                        r"correction \(NUC\) renewed offsets between the kinds"),
    "gains renewed": (_renewed(0.004, gain=True),
                      r"correction \(NUC\) renewed gains between the kinds"),
    "offsets renewed from the third on": (_renewed_from(2, 15.0, gain=False),
                                          r"\(NUC\) renewed offsets from 489.667 K on"),
    "gains renewed from the third on": (_renewed_from(2, 0.01, gain=True),
                                        r"\(NUC\) renewed gains from 489.667 K on"),
    "injections upside down": (_injections(lambda image: image[::-1]),
                               "injections at 423 K are upside down .*times smaller"),
    "one background mirrored": (
        _seen(lambda shot, image: image[:, ::-1] if shot.background_K == 423.0 else image),
        "references at 423 K are mirrored left to right .*times smaller"),
    "8 bits of 16": (_injections(lambda image: image // 64), r"gain \(exposure, range\) changed"),
}  # fmt: skip


def _said(name: str, seed: int) -> str:
    change, _ = FAULTS[name]
    truth: Made = made(seed)
    truth.recorded.shots = [change(shot, None) for shot in truth.recorded.shots]
    try:
        found = evaluate_shots(truth.recorded)
    except EvaluationError as error:
        return str(error)
    return "\n".join(one.text for one in found.witnesses if one.says)


def _best(text: str) -> str:
    """The text without causes that are within chance of the best."""
    return re.sub(r"; within chance: [^\n]*", "", text)


@pytest.mark.parametrize("seed", [31, pytest.param(32, marks=pytest.mark.slow)])
def test_nine_of_ten_faults_are_named(seed: int) -> None:
    missed = {
        name: text
        for name, (_, expected) in FAULTS.items()
        if not re.search(expected, _best(text := _said(name, seed)))
    }
    assert len(missed) <= len(FAULTS) // 10, "\n".join(f"{k}: {v}" for k, v in missed.items())
