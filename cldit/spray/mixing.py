"""Fuel mixed adiabatically with hot nitrogen: temperature and evaporated share, as a 1-D table.

Mixing-limited sprays (Siebers, SAE 1999-01-0528): where fuel and gas are mixed, they are in
equilibrium, so that the ratio B of fuel to nitrogen mass decides everything. While liquid is left
the vapour is saturated at the mixture's temperature; then only enthalpies mix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.errors import SprayError
from cldit.spray.fuel import (
    HEPTANE_CRITICAL_K,
    METHANE,
    NITROGEN,
    GAS_CONSTANT_J_mol_K,
    HEPTANE_CRITICAL_Pa,
    HEPTANE_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_liquid_enthalpy_J_kg,
    heptane_saturation_pressure_Pa,
    heptane_vapour_enthalpy_J_kg,
)

Floats = NDArray[np.float64]

_HALVINGS = 56  # of a bracket of at most 5000 K: down to rounding
_ENTRIES = 3000


@dataclass(frozen=True)
class Mixture:
    """States of the mixture, by rising fuel content; all (N,).

    fuel_kg_m3: fuel, liquid and vapour, in a cubic metre of mixture at the given pressure.
    saturation_B, saturation_K: where the last liquid evaporates; NaN for a gaseous fuel or
    without evaporation.
    """

    fuel_to_gas: Floats
    fuel_kg_m3: Floats
    temperature_K: Floats
    evaporated: Floats
    saturation_B: float
    saturation_K: float

    def at(self, fuel_kg_m3: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Temperature in K, evaporated share and fuel-to-gas ratio for a fuel content."""
        with np.errstate(divide="ignore"):
            wanted = np.log(np.asarray(fuel_kg_m3, dtype=float))
        known = np.log(self.fuel_kg_m3)
        return (
            np.interp(wanted, known, self.temperature_K),
            np.interp(wanted, known, self.evaporated),
            np.exp(np.interp(wanted, known, np.log(self.fuel_to_gas))),
        )

    def content(self, fuel_to_gas: ArrayLike) -> Floats:
        """Fuel in kg/m3 for a fuel-to-gas ratio; the ends of the table hold beyond them."""
        with np.errstate(divide="ignore"):
            wanted = np.log(np.asarray(fuel_to_gas, dtype=float))
        known = np.log(self.fuel_to_gas)
        return np.asarray(np.exp(np.interp(wanted, known, np.log(self.fuel_kg_m3))))


def heptane_state(
    fuel_to_gas: ArrayLike, *, pressure_Pa: float, gas_K: float, fuel_K: float
) -> tuple[Floats, Floats]:
    """Temperature in K and evaporated share of n-heptane mixed with nitrogen, element by element.

    Args:
        fuel_to_gas: B, mass of fuel by mass of nitrogen, > 0.
        gas_K, fuel_K: temperatures before mixing; the fuel is liquid.

    Raises:
        SprayError: the pressure is above the fuel's critical pressure.
    """
    if pressure_Pa >= HEPTANE_CRITICAL_Pa:
        raise SprayError(
            f"spray.ambient.pressure_Pa: {pressure_Pa:g} is above the critical pressure of "
            f"n-heptane; with evaporation the cone model allows less than {HEPTANE_CRITICAL_Pa:g}"
        )
    ratio = np.asarray(fuel_to_gas, dtype=float)
    supply = ratio * heptane_liquid_enthalpy_J_kg(fuel_K) + NITROGEN.enthalpy_J_kg(gas_K)

    def share(temperature: Floats) -> Floats:
        """Saturated nitrogen takes up to B_sat; all of the fuel if there is less."""
        mole = heptane_saturation_pressure_Pa(temperature) / pressure_Pa
        boiling = (mole >= 1) | (temperature >= HEPTANE_CRITICAL_K)
        mole = np.where(boiling, 0.5, mole)
        taken = HEPTANE_MOLAR_MASS_kg_mol / NITROGEN.molar_mass_kg_mol * mole / (1 - mole)
        return np.where(boiling, 1.0, np.minimum(1.0, taken / ratio))

    def excess(temperature: Floats) -> Floats:
        f = share(temperature)
        fuel = f * heptane_vapour_enthalpy_J_kg(temperature) + (
            1 - f
        ) * heptane_liquid_enthalpy_J_kg(temperature)
        return np.asarray(ratio * fuel + NITROGEN.enthalpy_J_kg(temperature) - supply)

    low = np.full(ratio.shape, 0.4 * min(gas_K, fuel_K))
    high = np.full(ratio.shape, max(gas_K, fuel_K) * (1 + 1e-12))
    temperature = rising_root(excess, low, high)
    return temperature, share(temperature)


def heptane_mixture(
    *, pressure_Pa: float, gas_K: float, fuel_K: float, evaporation: bool = True
) -> Mixture:
    """The table for liquid n-heptane in nitrogen; without evaporation no heat is exchanged."""
    ratio = np.geomspace(1e-9, 1e6, _ENTRIES)
    saturation_B = saturation_K = float("nan")
    if evaporation:
        conditions = {"pressure_Pa": pressure_Pa, "gas_K": gas_K, "fuel_K": fuel_K}
        saturation_B = _saturation(ratio, **conditions)
        if np.isfinite(saturation_B):
            ratio = np.unique(np.append(ratio, saturation_B))
        temperature, evaporated = heptane_state(ratio, **conditions)
        gas_temperature = temperature
        if np.isfinite(saturation_B):
            saturation_K = float(temperature[np.searchsorted(ratio, saturation_B)])
    else:
        temperature, evaporated = np.full(ratio.shape, fuel_K), np.zeros(ratio.shape)
        gas_temperature = np.full(ratio.shape, gas_K)
    per_pascal = GAS_CONSTANT_J_mol_K * gas_temperature / pressure_Pa
    volume = (  # of the mixture, per mass of fuel
        evaporated * per_pascal / HEPTANE_MOLAR_MASS_kg_mol
        + per_pascal / (NITROGEN.molar_mass_kg_mol * ratio)
        + (1 - evaporated) / heptane_density_kg_m3(temperature)
    )
    return Mixture(
        fuel_to_gas=ratio,
        fuel_kg_m3=1 / volume,
        temperature_K=temperature,
        evaporated=evaporated,
        saturation_B=saturation_B,
        saturation_K=saturation_K,
    )


def _saturation(ratio: Floats, **conditions: float) -> float:
    """The B at which the last liquid evaporates, by bisection between two entries of the table."""
    _, share = heptane_state(ratio, **conditions)
    first = int(np.argmax(share < 1))
    if share[first] == 1 or first == 0:
        return float("nan")  # everything or nothing evaporates, whatever the mixture
    low, high = ratio[first - 1], ratio[first]
    for _ in range(_HALVINGS):
        middle = np.sqrt(low * high)
        _, there = heptane_state(np.array([middle]), **conditions)
        low, high = (middle, high) if there[0] == 1 else (low, middle)
    return float(low)


def methane_mixture(
    *, pressure_Pa: float, gas_K: float, fuel_K: float, speed_m_s: float
) -> Mixture:
    """The table for a jet of methane in nitrogen, both ideal gases.

    Stagnation enthalpies mix, and momentum too: a mixture with mass fraction Z of methane moves
    at Z times the speed of the expanded jet, and what kinetic energy is gone is heat. So Z = 1 is
    the jet just expanded (coldest), and the dilute jet has the temperature of plain mixing.

    Args:
        fuel_K: stagnation temperature, in the injector.
        speed_m_s: of the jet expanded to the pressure of the gas.
    """
    ratio = np.geomspace(1e-9, 1e6, _ENTRIES)
    z = ratio / (1 + ratio)
    supply = (
        z * METHANE.enthalpy_J_kg(fuel_K)
        + (1 - z) * NITROGEN.enthalpy_J_kg(gas_K)
        - 0.5 * (z * speed_m_s) ** 2
    )

    def excess(temperature: Floats) -> Floats:
        methane, nitrogen = METHANE.enthalpy_J_kg(temperature), NITROGEN.enthalpy_J_kg(temperature)
        return np.asarray(z * methane + (1 - z) * nitrogen - supply)

    top = max(gas_K, fuel_K) * (1 + 1e-12)
    temperature = rising_root(excess, np.full(z.shape, 1.0), np.full(z.shape, top))
    per_pascal = GAS_CONSTANT_J_mol_K * temperature / pressure_Pa
    volume = per_pascal / METHANE.molar_mass_kg_mol + per_pascal / (
        NITROGEN.molar_mass_kg_mol * ratio
    )
    return Mixture(
        fuel_to_gas=ratio,
        fuel_kg_m3=1 / volume,
        temperature_K=temperature,
        evaporated=np.ones(z.shape),
        saturation_B=float("nan"),
        saturation_K=float("nan"),
    )


def rising_root(excess: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Root of a rising function between two bounds, element by element, by bisection."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        above = excess(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)
