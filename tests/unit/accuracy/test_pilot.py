"""Which earlier traces serve a pilot, and what its pictures foretell."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy import budget
from cldit.accuracy.budget import foretold_K
from cldit.accuracy.errors import Cause
from cldit.accuracy.picture import Picture
from cldit.accuracy.pilot import Pilot
from cldit.radiance.weights import Weights
from cldit.scene import Scene, load_scene, parse_scene

NOTHING: Any = None


def pilot_of(scene: Scene, *, node: Any = 0, drawn: Any = None, asked_K: float = 1.0) -> Pilot:
    probed: Any = SimpleNamespace(on_lattice=True, node=node, frame=SimpleNamespace(edge_m=0.2))
    settings: Any = SimpleNamespace(accuracy_K=asked_K)
    kept: Any = {7: "coarse", 8: "fine"}
    return Pilot(scene, NOTHING, settings, probed, drawn, NOTHING, kept)


def on_lattice(scene: Scene, spacing_m: float) -> Scene:
    spray = scene.spray.model_copy(update={"spacing_m": spacing_m})
    return scene.model_copy(update={"spray": spray})


def test_other_lattices_serve_in_the_same_light() -> None:
    """Wavelengths are chosen for each spray: T_app in another light is no error of the cells."""
    scene = load_scene("methane-jet")
    one, other = (on_lattice(scene, spacing_m) for spacing_m in (1e-3, 0.4e-3))
    before = pilot_of(one)
    served: Any = before._serving(other, pilot_of(other).probed)
    assert served == {0.2 / 2**7: "coarse", 0.2 / 2**8: "fine"}
    assert not before._serving(other, pilot_of(other, node=1).probed)
    data = other.model_dump(mode="json")
    data["camera"]["pixels"] = [20, 20]
    assert not before._serving(parse_scene(data), before.probed)


@pytest.mark.parametrize("drawn", [None, "some"])
def test_a_pilot_foretells_noise_and_pixels(drawn: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The noise of one wavelength, which is asked for less, is that of all, which is less.

    Pixels that lie apart tell nothing of the pixels of the picture.
    """
    pixels = Cause("pixel sampling", 0.2, "known"), None
    monkeypatch.setattr(budget, "pixel_error", lambda *_: pixels)
    monkeypatch.setattr(Picture, "error_K", lambda *_: 0.8)
    picture = Picture(Weights(*(np.zeros((4, 4), np.float32),) * 4))
    pilot = pilot_of(load_scene("gdi"), drawn=drawn, asked_K=2.0)
    found = foretold_K(pilot, picture, 0.5)
    assert found == {"trace": 0.2} | ({"pixel sampling": 0.2} if drawn is None else {})
