"""Constants of preset `paper` at wavelengths that are not the paper's: a remark, no silence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.optics.wavelengths import elsewhere
from cldit.scene import load_scene
from cldit.spray.result import Parcels, Spray


def _spray() -> Spray:
    nothing = np.zeros((1, 3))
    one = np.ones(1)
    return Spray(parcels=Parcels(nothing, 1e-5 * one, one, 300.0 * one, 700.0 * one))


@pytest.mark.parametrize(
    ("optics", "words"),
    [
        ({}, ()),
        ({"filter_um": (3.38, 3.42)}, ()),
        ({"filter_um": (3.25, 3.58)}, ()),
        ({"preset": "spectral", "filter_um": (2.0, 14.0)}, ()),
        ({"filter_um": (2.0, 14.0)}, ("constants",)),
        ({"wavelength_um": 0.2}, ("outside the filter", "constants")),
        ({"filter_um": (19.0, 21.0)}, ("outside the filter", "constants")),
        ({"filter_um": (19.0, 21.0), "wavelength_um": 20.0}, ("constants",)),
        ({"filter_um": (19.0, 21.0), "wavelength_um": 20.0, "n": 1.4, "k": 0.01}, ()),
    ],
)
def test_constants_at_other_wavelengths(optics: dict[str, Any], words: tuple[str, ...]) -> None:
    given = {"preset": "paper", **optics}
    scene = load_scene("gdi").with_(**{f"optics.{key}": value for key, value in given.items()})
    remarks = elsewhere(scene, _spray())
    assert len(remarks) == len(words)
    for remark, word in zip(remarks, words, strict=True):
        assert word in remark and remark.startswith("optics.")
