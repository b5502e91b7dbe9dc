"""Figures that every spray has: penetrations by mass, sizes, vapour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.gpu.device import open_device
from cldit.prepare.spray_factory import make_spray
from cldit.scene.spray import ConeSpray, EmptySpray
from cldit.spray.extent import Box
from cldit.spray.penetration import penetrations_m, with_figures
from cldit.spray.result import Parcels, Spray


def parcels(depth_m: list[float], droplets: list[float]) -> Parcels:
    place = np.zeros((len(depth_m), 3))
    place[:, 2] = -np.array(depth_m)
    ones = np.ones(len(depth_m))
    return Parcels(place, 1e-5 * ones, np.array(droplets), 300.0 * ones, 700.0 * ones)


def test_it_is_by_mass_and_not_by_number_of_parcels() -> None:
    """90 of 100 parts of the mass end at 2 mm, 96 at 3 mm; the order of parcels does not matter."""
    some = parcels([0.004, 0.001, 0.003, 0.002], [4.0, 50.0, 6.0, 40.0])
    assert penetrations_m(some, (0.90, 0.95, 0.99, 1.0)) == (0.002, 0.003, 0.004, 0.004)


def test_classes_of_a_box_are_sorted_once() -> None:
    """The depth is that of a sort of all parcels, one by one."""
    rng = np.random.default_rng(3)
    depth = np.repeat(1e-4 * rng.integers(1, 300, 2000), 4)
    some = replace(parcels(list(depth), list(rng.random(8000))), extent=Box(np.full(3, 1e-4)))
    shares = (0.1, 0.5, 0.9, 0.95, 0.99)
    order = np.argsort(depth)
    reached = np.cumsum(some.masses_kg[order])
    expected = [depth[order][np.argmax(reached >= share * reached[-1])] for share in shares]
    assert penetrations_m(some, shares) == tuple(expected)


def test_what_a_model_says_itself_stays() -> None:
    spray = Spray(parcels=parcels([0.001], [1.0]), notes={"liquid_mass_kg": 5.0})
    notes = with_figures(spray).notes
    assert notes["liquid_mass_kg"] == 5.0
    assert notes["liquid_penetration_95_m"] == 0.001
    assert notes["sauter_mean_diameter_m"] == pytest.approx(1e-5)


def test_no_liquid_has_no_penetration() -> None:
    assert make_spray(EmptySpray()).notes == {}
    notes = with_figures(Spray(parcels=parcels([0.001], [0.0]))).notes
    assert notes == {"liquid_mass_kg": 0.0}


def test_models_have_them() -> None:
    notes = make_spray(ConeSpray(spacing_m=2e-3), open_device()).notes
    some = [notes[f"liquid_penetration_{percent}_m"] for percent in (90, 95, 99)]
    assert 0.0 < some[0] <= some[1] <= some[2] < notes["vapour_penetration_m"]
