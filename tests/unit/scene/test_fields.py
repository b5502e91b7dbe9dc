"""Shipped scenes show their spray: it fills the frame, and no edge cuts it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.medium import prepare
from cldit.prepare.preview import previewed
from cldit.prepare.stages import Stages
from cldit.scene import load_scene
from cldit.scene.load import chosen_scene

_COARSE_GAS = {"spray.box.spacing_m": 3e-3, "spray.droplets_per_parcel": 3e4}
_COARSE_CONE = {"spray.spacing_m": 2e-3, "spray.size_classes": 2}


@pytest.mark.parametrize(
    ("name", "coarse"),
    [
        pytest.param("gdi", _COARSE_GAS, marks=pytest.mark.slow),
        pytest.param("methane-jet", _COARSE_GAS, marks=pytest.mark.slow),
        ("gdi-cone", _COARSE_CONE),
        ("gdi-cold", _COARSE_CONE),
        ("droplets-only", _COARSE_CONE),
    ],
)
def test_the_spray_fills_the_frame(
    name: str, coarse: dict[str, float], device: Device, tables: Path
) -> None:
    """By absorption and scattering on coarse cells, without light that is scattered.

    gdi-extinction has the camera of gdi, with which it is compared; its droplets fill less.
    """
    scene = chosen_scene(name, pixels=64).with_(**{"optics.wavelengths": 1, **coarse})
    emissivity = previewed(prepare(scene, device, Stages(None), tables))[1]
    visible = emissivity > VISIBLE_EMISSIVITY
    assert np.mean(visible) >= 0.3
    assert not visible[[0, -1]].any() and not visible[:, [0, -1]].any()


@pytest.mark.parametrize("name", ["gdi", "methane-jet"])
def test_traced_and_recorded_images_show_the_same_part(name: str) -> None:
    """Pixels are square, and the sensor covers the field."""
    camera = load_scene(name).camera
    for columns, rows in (camera.pixels, camera.sensor.pixels):
        sizes = (camera.field_m[0] / columns, camera.field_m[1] / rows)
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-6)
