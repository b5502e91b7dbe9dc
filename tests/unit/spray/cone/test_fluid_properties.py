"""Fits of the cone: against their own derivatives; against CoolProp in droplet/test_fluids.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.spray.cone import fluid_properties as fuel
from cldit.spray.cone.fluid_properties import NITROGEN


def test_latent_heat_between_the_enthalpies() -> None:
    """Exact at the boiling point; elsewhere as far off as the docstring says."""
    t = np.array([fuel.HEPTANE_BOILING_K, 280.0, 390.0, 440.0])
    gap = fuel.heptane_vapour_enthalpy_J_kg(t) - fuel.heptane_liquid_enthalpy_J_kg(t)
    off = np.abs(gap / fuel.heptane_latent_heat_J_kg(t) - 1)
    assert np.all(off < [1e-12, 0.02, 0.02, 0.07])


@pytest.mark.parametrize(
    ("enthalpy", "cp"),
    [
        (fuel.heptane_liquid_enthalpy_J_kg, fuel.heptane_liquid_cp_J_kg_K),
        (fuel.heptane_vapour_enthalpy_J_kg, fuel.heptane_vapour_cp_J_kg_K),
        (NITROGEN.enthalpy_J_kg, NITROGEN.cp_J_kg_K),
    ],
    ids=["liquid", "vapour", "nitrogen"],
)
def test_cp_is_the_slope_of_enthalpy(enthalpy: Callable[..., Any], cp: Callable[..., Any]) -> None:
    """Central difference: its error is h^2/6 times a third derivative, < 1e-6 at h = 0.05 K."""
    t = np.array([120.0, 190.0, 205.0, 300.0, 371.0, 480.0, 700.0, 999.0, 1001.0, 1800.0])
    slope = (enthalpy(t + 0.05) - enthalpy(t - 0.05)) / 0.1
    assert slope == pytest.approx(cp(t), rel=2e-6)


def test_far_outside_the_fits_everything_stays_finite_and_rising() -> None:
    t = np.linspace(30.0, 3000.0, 500)
    for enthalpy in (
        fuel.heptane_liquid_enthalpy_J_kg,
        fuel.heptane_vapour_enthalpy_J_kg,
        NITROGEN.enthalpy_J_kg,
    ):
        assert np.all(np.diff(enthalpy(t)) > 0)
