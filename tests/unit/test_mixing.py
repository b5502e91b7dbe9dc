"""Adiabatic mixtures: published saturation states, energy balance, limits, impossible input."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.spray.fuel import (
    METHANE,
    NITROGEN,
    GAS_CONSTANT_J_mol_K,
    HEPTANE_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_liquid_enthalpy_J_kg,
    heptane_saturation_pressure_Pa,
    heptane_vapour_enthalpy_J_kg,
)
from cldit.spray.methane import expand
from cldit.spray.mixing import heptane_mixture, heptane_state, methane_mixture

# p in MPa, T of the gas, T and B at saturation for fuel at 370 K, computed independently with other
# property data (rounded to 0.5 K and two digits).
SATURATION = [
    (0.15, 300.0, 286.5, 0.080),
    (0.15, 400.0, 317.0, 0.384),
    (0.15, 500.0, 330.0, 0.716),
    (0.15, 573.0, 336.5, 0.960),
    (0.15, 620.0, 340.0, 1.12),
    (0.6, 300.0, 294.5, 0.030),
    (0.6, 400.0, 340.5, 0.233),
    (0.6, 500.0, 360.0, 0.486),
    (0.6, 573.0, 369.0, 0.674),
    (0.6, 620.0, 374.0, 0.796),
    (0.9, 300.0, 296.0, 0.022),
    (0.9, 400.0, 347.0, 0.197),
    (0.9, 500.0, 370.0, 0.428),
    (0.9, 573.0, 380.0, 0.602),
    (0.9, 620.0, 385.0, 0.715),
]


@pytest.mark.parametrize(("megapascal", "gas_K", "saturation_K", "ratio"), SATURATION)
def test_saturation(megapascal: float, gas_K: float, saturation_K: float, ratio: float) -> None:
    """0.75 K and 3 %: half the reference's last digit, and 1 % between the property data."""
    table = heptane_mixture(pressure_Pa=megapascal * 1e6, gas_K=gas_K, fuel_K=370.0)
    assert table.saturation_K == pytest.approx(saturation_K, abs=0.75)
    assert pytest.approx(ratio, rel=0.03) == table.saturation_B


@pytest.mark.parametrize("gas_K", [250.0, 300.0, 570.0, 1500.0])
@pytest.mark.parametrize("fuel_K", [250.0, 370.0, 480.0])
@pytest.mark.parametrize("pressure_Pa", [0.1e6, 0.6e6, 2.5e6])
def test_energy_and_equilibrium(gas_K: float, fuel_K: float, pressure_Pa: float) -> None:
    """Enthalpy is kept to rounding; while liquid is left, the gas is saturated."""
    b = np.geomspace(1e-6, 1e4, 400)
    t, f = heptane_state(b, pressure_Pa=pressure_Pa, gas_K=gas_K, fuel_K=fuel_K)
    before = b * heptane_liquid_enthalpy_J_kg(fuel_K) + NITROGEN.enthalpy_J_kg(gas_K)
    fuel = f * heptane_vapour_enthalpy_J_kg(t) + (1 - f) * heptane_liquid_enthalpy_J_kg(t)
    after = b * fuel + NITROGEN.enthalpy_J_kg(t)
    assert np.max(np.abs(after - before) / (1e6 * (1 + b))) < 1e-9
    moles = f * b / HEPTANE_MOLAR_MASS_kg_mol * NITROGEN.molar_mass_kg_mol
    partial = pressure_Pa * moles / (1 + moles)
    wet = f < 1
    assert partial[wet] == pytest.approx(heptane_saturation_pressure_Pa(t[wet]), rel=1e-6)
    # A flashing fuel boils at the vessel's pressure: the slack is the rounding of 1 - X.
    assert np.all(partial <= heptane_saturation_pressure_Pa(t) * (1 + 1e-9))
    if gas_K > fuel_K:  # colder gas first condenses what more of the hot fuel evaporates again
        assert np.all(np.diff(f) <= 1e-12)


def test_limits() -> None:
    t, f = heptane_state(np.array([1e-9, 1e9]), pressure_Pa=0.6e6, gas_K=570.0, fuel_K=370.0)
    assert t == pytest.approx([570.0, 370.0], abs=1e-3)
    assert f == pytest.approx([1.0, 0.0], abs=1e-6)


def test_superheated_fuel_flashes_to_the_boiling_point() -> None:
    t, f = heptane_state(np.array([1e8]), pressure_Pa=0.1e6, gas_K=300.0, fuel_K=400.0)
    assert float(heptane_saturation_pressure_Pa(t[0])) == pytest.approx(0.1e6, rel=1e-4)
    assert 0.1 < f[0] < 0.4


def test_table_inverts_itself_between_its_entries() -> None:
    """Linear look-up in ln B; 1e-3 relative is the square of the table's step."""
    table = heptane_mixture(pressure_Pa=0.6e6, gas_K=570.0, fuel_K=370.0)
    b = np.geomspace(1e-7, 1e5, 777)
    t, f, back = table.at(table.content(b))
    exact_t, exact_f = heptane_state(b, pressure_Pa=0.6e6, gas_K=570.0, fuel_K=370.0)
    assert back == pytest.approx(b, rel=1e-3)
    assert t == pytest.approx(exact_t, abs=0.02)
    assert f == pytest.approx(exact_f, abs=1e-4)
    assert np.all(np.diff(table.fuel_kg_m3) > 0)


def test_content_fills_a_cubic_metre() -> None:
    """Gas volumes at the pressure (ideal), plus the liquid's own, from the state alone."""
    table = heptane_mixture(pressure_Pa=0.6e6, gas_K=570.0, fuel_K=370.0)
    c, b, f, t = table.fuel_kg_m3, table.fuel_to_gas, table.evaporated, table.temperature_K
    moles = c * f / HEPTANE_MOLAR_MASS_kg_mol + c / b / NITROGEN.molar_mass_kg_mol
    volume = moles * GAS_CONSTANT_J_mol_K * t / 0.6e6 + c * (1 - f) / heptane_density_kg_m3(t)
    assert volume == pytest.approx(1.0, rel=1e-12)


def test_without_evaporation_all_stays_liquid() -> None:
    table = heptane_mixture(pressure_Pa=5e6, gas_K=570.0, fuel_K=370.0, evaporation=False)
    assert np.all(table.evaporated == 0)
    assert np.all(table.temperature_K == 370.0)
    assert np.isnan(table.saturation_K)


def test_supercritical_gas_is_refused() -> None:
    with pytest.raises(SprayError, match=r"ambient.pressure_Pa: 3e\+06 is above the critical"):
        heptane_mixture(pressure_Pa=3e6, gas_K=570.0, fuel_K=370.0)


def test_methane_expansion_against_constant_heat_capacity() -> None:
    """Choked flow of gamma = 1.3: p0/sqrt(R T0) sqrt(g) (2/(g+1))^((g+1)/(2(g-1))), to 1 %."""
    jet = expand(stagnation_Pa=15e6, stagnation_K=300.0, pressure_Pa=8e6)
    g = 1.302  # cp/cv at 285 K, halfway to the throat
    gas = METHANE.gas_constant_J_kg_K
    flux = 15e6 / np.sqrt(gas * 300.0) * np.sqrt(g) * (2 / (g + 1)) ** ((g + 1) / (2 * (g - 1)))
    assert jet.flux_kg_m2_s == pytest.approx(flux, rel=0.01)
    assert jet.temperature_K == pytest.approx(300.0 * (8 / 15) ** ((g - 1) / g), rel=0.01)


def test_methane_keeps_energy_with_its_motion() -> None:
    jet = expand(stagnation_Pa=15e6, stagnation_K=370.0, pressure_Pa=0.4e6)
    assert jet.temperature_K < 170.0
    table = methane_mixture(pressure_Pa=0.4e6, gas_K=520.0, fuel_K=370.0, speed_m_s=jet.speed_m_s)
    assert table.temperature_K[-1] == pytest.approx(jet.temperature_K, abs=0.01)
    assert table.temperature_K[0] == pytest.approx(520.0, abs=1e-3)
    z = table.fuel_to_gas / (1 + table.fuel_to_gas)
    static = z * METHANE.enthalpy_J_kg(table.temperature_K)
    static += (1 - z) * NITROGEN.enthalpy_J_kg(table.temperature_K)
    supply = z * METHANE.enthalpy_J_kg(370.0) + (1 - z) * NITROGEN.enthalpy_J_kg(520.0)
    assert np.max(np.abs(static + 0.5 * (z * jet.speed_m_s) ** 2 - supply)) < 1e-3  # of 1e6 J/kg
    assert np.all(np.diff(table.fuel_kg_m3) > 0)
