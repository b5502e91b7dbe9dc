"""Fluid properties against CoolProp and against their own derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.spray.cone import fluid_properties as fuel
from cldit.spray.cone.fluid_properties import NITROGEN

# CoolProp 8.0, n-heptane, saturated: T, p_sat, density, cp of the liquid, latent heat, cp of the
# ideal gas.
COOLPROP = [
    (280.0, 2293.25, 694.742, 2175.45, 376341.0, 1571.55),
    (300.0, 6674.91, 677.938, 2247.67, 363968.0, 1656.46),
    (340.0, 36178.1, 643.240, 2412.60, 338564.0, 1833.69),
    (370.0, 96840.0, 615.673, 2550.66, 317990.0, 1968.77),
    (400.0, 218249.0, 586.027, 2700.75, 295092.0, 2102.34),
    (420.0, 348500.0, 564.600, 2809.79, 277958.0, 2189.49),
]


@pytest.mark.parametrize("row", COOLPROP, ids=lambda row: f"{row[0]:g}K")
def test_heptane_agrees_with_coolprop(row: tuple[float, ...]) -> None:
    """1 % is the spread of the two correlations' sources; measured here: 0.8 % at most."""
    t = row[0]
    found = (
        fuel.heptane_saturation_pressure_Pa(t),
        fuel.heptane_density_kg_m3(t),
        fuel.heptane_liquid_cp_J_kg_K(t),
        fuel.heptane_latent_heat_J_kg(t),
        fuel.heptane_vapour_cp_J_kg_K(t),
    )
    assert np.array(found) == pytest.approx(row[1:], rel=0.01)


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


def test_nitrogen_at_room_temperature() -> None:
    """NIST WebBook: 29.12 J/mol/K at 300 K."""
    nitrogen = NITROGEN.cp_J_kg_K(300.0) * NITROGEN.molar_mass_kg_mol
    assert float(nitrogen) == pytest.approx(29.12, rel=2e-3)


def test_far_outside_the_fits_everything_stays_finite_and_rising() -> None:
    t = np.linspace(30.0, 3000.0, 500)
    for enthalpy in (
        fuel.heptane_liquid_enthalpy_J_kg,
        fuel.heptane_vapour_enthalpy_J_kg,
        NITROGEN.enthalpy_J_kg,
    ):
        assert np.all(np.diff(enthalpy(t)) > 0)
