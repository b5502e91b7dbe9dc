"""Adiabatic mixtures: published saturation states, energy balance, limits, impossible input."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.constants import GAS_CONSTANT_J_mol_K, HEPTANE_MOLAR_MASS_kg_mol
from cldit.spray.cone.fluid_properties import (
    NITROGEN_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_liquid_enthalpy_J_kg,
    heptane_saturation_pressure_Pa,
    heptane_vapour_enthalpy_J_kg,
    nitrogen_enthalpy_J_kg,
)
from cldit.spray.cone.mixing import (
    Mixture,
    heptane_mixture,
    heptane_state,
    lagging_state,
)
from cldit.spray.cone.wet_bulb import at_rest
from cldit.spray.droplet.arrays import DropletKernels

HOT = {"pressure_Pa": 0.6e6, "gas_K": 570.0, "fuel_K": 370.0}

# p in MPa, T of the gas, T and B at saturation for fuel at 370 K, computed independently with other
# property data (rounded to 0.5 K and two digits).
SATURATION = [
    (0.15, 300.0, 286.5, 0.080),
    (0.15, 620.0, 340.0, 1.12),
    (0.6, 400.0, 340.5, 0.233),
    (0.6, 573.0, 369.0, 0.674),
    (0.9, 300.0, 296.0, 0.022),
    (0.9, 620.0, 385.0, 0.715),
]


@pytest.fixture(scope="module")
def hot(kernels: DropletKernels) -> Mixture:
    return heptane_mixture(kernels, **HOT)


@pytest.mark.parametrize(("megapascal", "gas_K", "saturation_K", "ratio"), SATURATION)
def test_saturation(
    kernels: DropletKernels, megapascal: float, gas_K: float, saturation_K: float, ratio: float
) -> None:
    """0.75 K and 3 %: half the reference's last digit, and 1 % between the property data."""
    table = heptane_mixture(kernels, pressure_Pa=megapascal * 1e6, gas_K=gas_K, fuel_K=370.0)
    assert table.saturation_K == pytest.approx(saturation_K, abs=0.75)
    assert pytest.approx(ratio, rel=0.03) == table.saturation_B


@pytest.mark.parametrize("gas_K", [250.0, 300.0, 570.0, 1500.0])
@pytest.mark.parametrize("fuel_K", [250.0, 370.0, 480.0])
@pytest.mark.parametrize("pressure_Pa", [0.1e6, 0.6e6, 2.5e6])
def test_energy_and_equilibrium(gas_K: float, fuel_K: float, pressure_Pa: float) -> None:
    """Enthalpy is kept to rounding; while liquid is left, the gas is saturated."""
    b = np.geomspace(1e-6, 1e4, 400)
    t, f = heptane_state(b, pressure_Pa=pressure_Pa, gas_K=gas_K, fuel_K=fuel_K)
    before = b * heptane_liquid_enthalpy_J_kg(fuel_K) + nitrogen_enthalpy_J_kg(gas_K)
    fuel = f * heptane_vapour_enthalpy_J_kg(t) + (1 - f) * heptane_liquid_enthalpy_J_kg(t)
    after = b * fuel + nitrogen_enthalpy_J_kg(t)
    assert np.max(np.abs(after - before) / (1e6 * (1 + b))) < 1e-9
    moles = f * b / HEPTANE_MOLAR_MASS_kg_mol * NITROGEN_MOLAR_MASS_kg_mol
    partial = pressure_Pa * moles / (1 + moles)
    wet = f < 1
    assert partial[wet] == pytest.approx(heptane_saturation_pressure_Pa(t[wet]), rel=1e-6)
    # A flashing fuel boils at the vessel's pressure: the slack is the rounding of 1 - X.
    assert np.all(partial <= heptane_saturation_pressure_Pa(t) * (1 + 1e-9))
    if gas_K > fuel_K:  # colder gas first condenses what more of the hot fuel evaporates again
        assert np.all(np.diff(f) <= 1e-12)


def test_superheated_fuel_flashes_to_the_boiling_point() -> None:
    t, f = heptane_state(np.array([1e8]), pressure_Pa=0.1e6, gas_K=300.0, fuel_K=400.0)
    assert float(heptane_saturation_pressure_Pa(t[0])) == pytest.approx(0.1e6, rel=1e-4)
    assert 0.1 < f[0] < 0.4


@pytest.mark.parametrize("kinetic", [0.0, 0.13, 0.5, 0.9, 1.0])
def test_table_inverts_itself_between_its_entries(
    hot: Mixture, kernels: DropletKernels, kinetic: float
) -> None:
    """Look-up in ln B, steps of 0.04 and of 0.025 in the share. Where time and saturation limit
    alike both temperatures have a kink, that the table rounds by a quarter of step times slope in
    either direction: 0.04 * 150 K / 4 in ln B, 0.025 * 200 K / 4 in the share."""
    table = hot
    b = np.geomspace(2e-4, 8e2, 777)
    gas_K, liquid_K, evaporated, ratio = table.at(table.content(b, kinetic), kinetic)
    exact_t, exact_f = heptane_state(b, **HOT)
    limited = np.minimum(exact_f, kinetic)
    assert ratio == pytest.approx(b, rel=5e-3)
    assert evaporated == pytest.approx(limited, abs=3e-3)
    lags = kinetic < exact_f
    gas, liquid = exact_t.copy(), exact_t.copy()
    if lags.any():
        gas[lags], liquid[lags] = lagging_state(b[lags], limited[lags], kernels, **HOT)
    assert gas_K == pytest.approx(gas, abs=2.75)
    wet = limited < 1
    assert liquid_K[wet] == pytest.approx(liquid[wet], abs=2.75)
    assert np.all(np.diff(table.fuel_kg_m3, axis=1) > 0)


@pytest.mark.parametrize("megapascal", [0.15, 0.6])
@pytest.mark.parametrize("gas_K", [300.0, 570.0])
def test_lagging_droplets_keep_energy_at_the_wet_bulb(
    kernels: DropletKernels, gas_K: float, megapascal: float
) -> None:
    """Enthalpy to 1 J of some 1e5 a kilogram (Newton's last step); the heat that reaches the
    droplet evaporates, by the formula of Abramzon and Sirignano. In equilibrium nothing lags."""
    conditions = {"pressure_Pa": megapascal * 1e6, "gas_K": gas_K, "fuel_K": 370.0}
    b = np.geomspace(1e-3, 3.0, 60)
    _, f = heptane_state(b, **conditions)
    share = 0.7 * f
    gas, liquid = lagging_state(b, share, kernels, **conditions)
    held = share * heptane_vapour_enthalpy_J_kg(gas)
    held += (1 - share) * heptane_liquid_enthalpy_J_kg(liquid)
    supply = b * heptane_liquid_enthalpy_J_kg(370.0) + nitrogen_enthalpy_J_kg(gas_K)
    assert b * held + nitrogen_enthalpy_J_kg(gas) == pytest.approx(supply, abs=1.0)
    y = share * b / (1 + share * b)
    around = at_rest(liquid, kernels, gas_K=gas, vapour_share=y, pressure_Pa=megapascal * 1e6)
    latent = heptane_vapour_enthalpy_J_kg(liquid) - heptane_liquid_enthalpy_J_kg(liquid)
    assert np.max(np.abs(around.heat_W / (around.mass_kg_s * latent))) < 1e-5
    wet = f < 1
    both = lagging_state(b[wet], f[wet], kernels, **conditions)
    equal, _ = heptane_state(b[wet], **conditions)
    assert both[0] == pytest.approx(equal, abs=0.01)
    assert both[1] == pytest.approx(equal, abs=0.01)


@pytest.mark.parametrize(("fuel_to_gas", "tolerance_K"), [(1.0, 1.7), (10.0, 1.7), (100.0, 5.5)])
def test_rich_mixtures_between_the_slices(
    hot: Mixture, kernels: DropletKernels, fuel_to_gas: float, tolerance_K: float
) -> None:
    """Against the balance itself, at shares below that of equilibrium, 1 % for the richest. The
    tolerance is the largest error of 20,000 random states; in steps of 1.25 % it was 44 K."""
    _, equilibrium = heptane_state(np.array([fuel_to_gas]), **HOT)
    share = equilibrium * np.linspace(0.02, 0.98, 49)
    gas, _ = lagging_state(np.full(share.shape, fuel_to_gas), share, kernels, **HOT)
    assert hot.gas_at(np.full(share.shape, fuel_to_gas), share) == pytest.approx(
        gas, abs=tolerance_K
    )


@pytest.mark.parametrize("kinetic", [0.2, 0.6, 1.0])
def test_looked_up_states_keep_energy(hot: Mixture, kinetic: float) -> None:
    """What the cone takes from the table for a fuel content. 0.5 % of the heat that the gas could
    give: 1.5 K of 200 K, where time and saturation limit alike, and far less elsewhere."""
    gas_K, liquid_K, f, b = hot.at(np.geomspace(1e-3, 100.0, 500), kinetic)
    held = f * heptane_vapour_enthalpy_J_kg(gas_K)
    held += (1 - f) * heptane_liquid_enthalpy_J_kg(liquid_K)
    off = b * held + nitrogen_enthalpy_J_kg(gas_K)
    off -= b * heptane_liquid_enthalpy_J_kg(370.0) + nitrogen_enthalpy_J_kg(570.0)
    scale = nitrogen_enthalpy_J_kg(570.0) - nitrogen_enthalpy_J_kg(370.0)
    off /= (1 + b) * scale
    assert np.max(np.abs(off)) < 5e-3
    assert np.median(np.abs(off)) < 3e-4


def test_content_fills_a_cubic_metre(hot: Mixture) -> None:
    """Gas volumes at the pressure (ideal), plus the liquid's own, from the state alone."""
    table = hot
    c, b, t = table.fuel_kg_m3, table.fuel_to_gas, table.gas_K
    f = np.minimum(table.kinetic[:, None], table.equilibrium)
    moles = c * f / HEPTANE_MOLAR_MASS_kg_mol + c / b / NITROGEN_MOLAR_MASS_kg_mol
    liquid = c * (1 - f) / heptane_density_kg_m3(table.liquid_K)
    assert moles * GAS_CONSTANT_J_mol_K * t / 0.6e6 + liquid == pytest.approx(1.0, rel=1e-12)


def test_many_states_are_those_of_each_alone(hot: Mixture) -> None:
    """States are looked up in parts; where a part ends does not matter."""
    rng = np.random.default_rng(1)
    content, kinetic = np.exp(rng.uniform(-8.0, 6.0, 50_000)), rng.random(50_000)
    many = hot.at(content, kinetic)
    for chosen in ([0, 19_999, 20_000, 39_999, 40_000, 49_999], np.arange(19_000, 21_000)):
        few = hot.at(content[chosen], kinetic[chosen])
        for whole, values in zip(many, few, strict=True):
            np.testing.assert_array_equal(whole[chosen], values)
