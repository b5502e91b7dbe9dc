"""Fuel tables: against CoolProp itself, and against a fit of another source."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.spray.cone import fluid_properties as fits
from cldit.spray.droplet.fluids import Fuel, diffusivity_m2_s, fuel_table, gas_table
from tests.unit.spray.flow.references import saturation_Pa

# Stated accuracy of the tables; measured: 5e-7 at most.
TABLE = 1e-5


@pytest.fixture(scope="module")
def heptane() -> Fuel:
    return fuel_table("n-heptane", cache=None)


@pytest.mark.parametrize("name", ["n-Heptane", "n-Dodecane", "Methane"])
def test_between_its_points_a_table_is_what_it_was_built_from(name: str) -> None:
    import CoolProp.CoolProp as coolprop  # takes two seconds, which every worker would spend

    table = fuel_table(name.lower(), cache=None)
    state = coolprop.AbstractState("HEOS", name)
    rng = np.random.default_rng(1)
    at = rng.uniform(table.liquid.low_K, table.liquid.high_K, 300)
    rows = []
    for t in at:
        state.update(coolprop.QT_INPUTS, 1.0, t)
        vapour = state.hmass()
        state.update(coolprop.QT_INPUTS, 0.0, t)
        rows.append((state.p(), state.rhomass(), state.cpmass(), vapour - state.hmass()))
    wanted = np.array(rows).T
    found = np.array([saturation_Pa(table, at), *table.liquid.at(at, "density", "cp", "latent")])
    assert np.abs(found / wanted - 1).max() < TABLE
    hot = rng.uniform(table.vapour.low_K, table.vapour.high_K, 50)
    cp = [coolprop.PropsSI("Cp0mass", "T", t, "Dmass", 1e-6, name) for t in hot]
    assert np.abs(table.vapour.value("cp", hot) / cp - 1).max() < TABLE


def test_heptane_against_the_fits_of_another_source(heptane: Fuel) -> None:
    """The NSRDS fits of the cone model: 1 % is their distance from CoolProp at 280 to 420 K."""
    t = np.linspace(280.0, 420.0, 29)
    density, cp, latent = heptane.liquid.at(t, "density", "cp", "latent")
    assert density == pytest.approx(fits.heptane_density_kg_m3(t), rel=0.01)
    assert cp == pytest.approx(fits.heptane_liquid_cp_J_kg_K(t), rel=0.01)
    assert latent == pytest.approx(fits.heptane_latent_heat_J_kg(t), rel=0.01)
    vapour = heptane.vapour.value("cp", t)
    assert vapour == pytest.approx(fits.heptane_vapour_cp_J_kg_K(t), rel=0.01)
    pressure = saturation_Pa(heptane, t)
    assert pressure == pytest.approx(fits.heptane_saturation_pressure_Pa(t), rel=0.01)


def test_nitrogen_against_the_polynomials_of_another_source() -> None:
    """Below 300 K the polynomials (0.6 % off cp at 250 K) are themselves extrapolated."""
    t = np.linspace(300.0, 1200.0, 39)
    found = gas_table("nitrogen", cache=None).vapour
    assert found.value("cp", t) == pytest.approx(fits.nitrogen_cp_J_kg_K(t), rel=3e-3)


def test_iso_octane_at_its_boiling_point() -> None:
    """99.2 C (handbooks), there L = 271 kJ/kg; and at 310 K, where the vapour is ideal to 1 %,
    L and psat are one by Clausius and Clapeyron."""
    table = fuel_table("Iso-octane", cache=None)
    boiling = float(table.boiling_K(101325.0))
    assert boiling == pytest.approx(372.4, abs=0.2)
    assert float(table.liquid.value("latent", boiling)) == pytest.approx(271e3, rel=0.01)
    slope = float(np.log(saturation_Pa(table, 310.5) / saturation_Pa(table, 309.5)))
    ideal = 8.314 / table.molar_mass_kg_mol * 310.0**2 * slope
    assert float(table.liquid.value("latent", 310.0)) == pytest.approx(ideal, rel=0.02)


def test_enthalpies_are_integrals_on_one_zero(heptane: Fuel) -> None:
    t = np.linspace(250.0, 500.0, 6)
    step = 0.01
    for curves in (heptane.liquid, heptane.vapour):
        rise = curves.value("enthalpy", t + step) - curves.value("enthalpy", t - step)
        assert rise / (2 * step) == pytest.approx(curves.value("cp", t), rel=1e-5)
    boiling = heptane.boiling_K(101325.0)
    gap = heptane.vapour.value("enthalpy", boiling) - heptane.liquid.value("enthalpy", boiling)
    # The boiling point is between two points of the grid, 0.4 K apart.
    assert float(gap) == pytest.approx(float(heptane.liquid.value("latent", boiling)), rel=1e-5)


def test_diffusivity_of_heptane_in_nitrogen(heptane: Fuel) -> None:
    """Fuller with the published volumes, by hand: 7.42e-6 m2/s at 300 K and 1 bar."""
    nitrogen = gas_table("nitrogen", cache=None)
    found = diffusivity_m2_s(heptane, nitrogen, temperature_K=300.0, pressure_Pa=1e5)
    assert float(found) == pytest.approx(7.42e-6, rel=1e-3)
    double = diffusivity_m2_s(heptane, nitrogen, temperature_K=600.0, pressure_Pa=2e5)
    assert float(double / found) == pytest.approx(2**0.75)


def test_rings_lower_the_diffusion_volume() -> None:
    """Fuller 1969: 7 C, 8 H and an aromatic ring."""
    found = fuel_table("toluene", cache=None).diffusion_volume
    assert found == pytest.approx(7 * 15.9 + 8 * 2.31 - 18.3)


def test_boiling_inverts_saturation(heptane: Fuel) -> None:
    t = np.linspace(200.0, 530.0, 40)
    assert heptane.boiling_K(saturation_Pa(heptane, t)) == pytest.approx(t, abs=1e-9)


def test_beyond_its_ends_a_curve_is_held(heptane: Fuel) -> None:
    ends = heptane.liquid.value("density", [heptane.liquid.low_K, heptane.liquid.high_K])
    assert heptane.liquid.value("density", [1.0, 1e5]) == pytest.approx(ends)
    assert heptane.liquid.high_K == pytest.approx(530.4, abs=0.1)  # 0.98 of CoolProp's 541.23 K


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("n-heptan", "did you mean n-heptane"),
        ("diesel", "neither iso-octane nor a fluid of CoolProp"),
        ("R12", "molecules of C, H and O"),
        ("DimethylEther", "lacks its transport properties"),
    ],
)
def test_fuels_that_cannot_be_had(name: str, says: str) -> None:
    with pytest.raises(SprayError, match=says):
        fuel_table(name, cache=None)


def test_gases_that_cannot_be_had() -> None:
    with pytest.raises(SprayError, match="nitrogen, air, oxygen"):
        gas_table("smoke", cache=None)
    assert gas_table("carbon-dioxide", cache=None).molar_mass_kg_mol == pytest.approx(
        0.04401, rel=1e-4
    )
