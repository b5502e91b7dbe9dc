"""Light from below: where droplets are seen, and the circle that contains most of it."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.spray.result import Parcels, Spray
from cldit.study.paper.instruments import from_below, reach_of_plumes_mm, within_m


def test_circle_of_an_even_disc() -> None:
    """97 % of an even disc of radius 1 is within sqrt(0.97)."""
    radius = np.sqrt((np.arange(100_000) + 0.5) / 100_000)
    np.random.default_rng(1).shuffle(radius)
    assert within_m(radius, np.full(radius.shape, 2e-9)) == pytest.approx(np.sqrt(0.97), rel=1e-4)


def test_lower_end_is_nearest_to_the_camera() -> None:
    """The camera is on the side of -y; a droplet at x, y is seen at x to the right and y up."""
    one = np.ones(1)
    parcels = Parcels(np.array([[1e-3, 2e-3, -3e-2]]), 9e-6 * one, one, 350 * one, 600 * one)
    seen = from_below(Spray(parcels=parcels)).parcels
    assert seen is not None and seen.position_m.tolist() == [[1e-3, -3e-2, 2e-3]]


def test_each_plume_has_its_own_penetration() -> None:
    """A droplet on the axis of each of eight plumes, 1 to 8 mm from the injector's axis."""
    angle = np.radians(22.5 + 45.0 * np.arange(8))
    radius_m = 1e-3 * np.arange(1.0, 9.0)
    place = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), -0.02 * np.ones(8)], 1)
    one = np.ones(8)
    parcels = Parcels(place, 9e-6 * one, one, 350 * one, 600 * one)
    assert reach_of_plumes_mm(Spray(parcels=parcels)) == pytest.approx([1, 2, 3, 4, 5, 6, 7, 8])
