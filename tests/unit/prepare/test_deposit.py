"""Which scenes spread their parcels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.medium.cloud import Kernel
from cldit.prepare.medium import deposited
from cldit.scene import Scene, parse_scene
from cldit.spray.extent import Box, Cloud
from cldit.spray.result import Parcels, Spray


def _scene(**spray: Any) -> Scene:
    return parse_scene({"name": "s", "spray": spray})


def _parcels() -> Parcels:
    place = np.random.default_rng(1).normal(0, 1e-3, (50, 3))
    one = np.ones(50)
    return Parcels(place, 1e-5 * one, 1e3 * one, 350.0 * one, 600.0 * one)


@pytest.mark.parametrize(
    ("spray", "cloud"),
    [
        ({"model": "lagrangian"}, True),
        ({"model": "lagrangian", "deposit": "points"}, False),
        ({"model": "cfd", "file": "case"}, True),
        ({"model": "cfd", "file": "case", "deposit": "points"}, False),
        ({"model": "cone"}, True),  # parcels that are given from Python in place of its own
    ],
    ids=str,
)
def test_clouds_unless_points_are_wanted(spray: dict[str, Any], cloud: bool) -> None:
    found = deposited(_scene(**spray), Spray(parcels=_parcels())).parcels
    assert found is not None
    assert isinstance(found.extent, Cloud) == cloud
    if cloud:
        np.testing.assert_array_equal(found.position_m, Kernel().spread(_parcels()).position_m)


def test_what_is_spread_already_stays() -> None:
    scene = _scene(model="lagrangian")
    once = deposited(scene, Spray(parcels=_parcels()))
    assert deposited(scene, once) is once
    boxed = Spray(parcels=replace(_parcels(), extent=Box(np.full(3, 1e-3))))
    assert deposited(scene, boxed) is boxed
    assert deposited(scene, Spray()).parcels is None
