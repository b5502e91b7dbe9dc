"""Adiabatic mixtures of fuel with hot nitrogen: table of temperatures and evaporated share.

Mixing-limited sprays (Siebers, SAE 1999-01-0528): mixed fuel and gas are in equilibrium, so that
the state depends only on the ratio B of fuel to nitrogen mass. While there is liquid, the vapour is
saturated at the temperature of the mixture; beyond that only enthalpies mix. For droplets that have
not had time for equilibrium, the evaporated share is the second axis of the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats, Ints
from cldit.constants import GAS_CONSTANT_J_mol_K, HEPTANE_MOLAR_MASS_kg_mol
from cldit.errors import SprayError
from cldit.io.free_memory import parts
from cldit.spray.bisection import rising_root
from cldit.spray.cone.fluid_properties import (
    HEPTANE_CRITICAL_K,
    HEPTANE_CRITICAL_Pa,
    NITROGEN_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_liquid_enthalpy_J_kg,
    heptane_saturation_pressure_Pa,
    heptane_vapour_cp_J_kg_K,
    heptane_vapour_enthalpy_J_kg,
    nitrogen_cp_J_kg_K,
    nitrogen_enthalpy_J_kg,
)
from cldit.spray.cone.wet_bulb import at_rest
from cldit.spray.droplet.arrays import DropletKernels

# Evaporated shares from 0 to 1, linear between them. Rich mixtures are saturated at a share of some
# 1 %, so steps grow from 0.02 to 2.5 %: gas within 5 K at B up to 100, where even ones leave 44 K.
_SLICES = 81


@dataclass(frozen=True)
class Mixture:
    """States by fuel-to-gas ratio B (N,) and by the share that kinetics allows to evaporate (A,).

    fuel_to_gas: rising. kinetic: rising from 0 to 1. equilibrium: evaporated share in equilibrium,
    (N,). fuel_kg_m3: fuel, liquid and vapour, in a cubic metre of mixture at the given pressure,
    rising with B, (A, N). gas_K, liquid_K: (A, N).
    saturation_B, saturation_K: where the last liquid evaporates in equilibrium; NaN without
    evaporation.
    """

    fuel_to_gas: Floats
    kinetic: Floats
    equilibrium: Floats
    fuel_kg_m3: Floats
    gas_K: Floats
    liquid_K: Floats
    saturation_B: float = float("nan")
    saturation_K: float = float("nan")

    def at(self, fuel_kg_m3: ArrayLike, kinetic: ArrayLike = 1.0) -> tuple[Floats, ...]:
        """gas_K, liquid_K, evaporated share of the fuel, and ratio B, at a fuel content.

        `kinetic` is the share that has had time to evaporate. All have one shape; values beyond
        the table are those of its ends.
        """
        content, share = np.broadcast_arrays(np.asarray(fuel_kg_m3, dtype=float), kinetic)
        state = tuple(np.empty(content.shape) for _ in range(4))
        targets = [array.reshape(-1) for array in state]
        content, share = content.reshape(-1), share.reshape(-1)
        for part in parts(content.size):
            state_part = self._state(content[part], share[part])
            for target, values in zip(targets, state_part, strict=True):
                target[part] = values
        return state

    def _state(self, fuel_kg_m3: Floats, kinetic: Floats) -> tuple[Floats, ...]:
        with np.errstate(divide="ignore"):
            log_content = np.log(fuel_kg_m3)
        axis, tables = self._by_content
        gas, liquid, ratio = bilinear(self.kinetic, axis, tables, kinetic, log_content)
        fuel_to_gas = np.exp(ratio)
        return gas, liquid, self.evaporated(fuel_to_gas, kinetic), fuel_to_gas

    def evaporated(self, fuel_to_gas: ArrayLike, kinetic: ArrayLike = 1.0) -> Floats:
        """Evaporated share, any shape: the smaller of `kinetic` and that of equilibrium."""
        with np.errstate(divide="ignore"):
            log_ratio = np.log(np.asarray(fuel_to_gas, dtype=float))
        allowed = np.interp(log_ratio, self._logarithms[0], self.equilibrium)
        return np.asarray(np.minimum(allowed, kinetic))

    def content(self, fuel_to_gas: ArrayLike, kinetic: ArrayLike = 1.0) -> Floats:
        """Fuel [kg/m3] at the ratio `fuel_to_gas` and the evaporated share `kinetic`, any shape."""
        with np.errstate(divide="ignore"):
            log_ratio = np.log(np.asarray(fuel_to_gas, dtype=float))
        ratio, log_content = self._logarithms
        (content,) = bilinear(self.kinetic, ratio, [log_content], kinetic, log_ratio)
        return np.asarray(np.exp(content))

    def gas_at(self, fuel_to_gas: ArrayLike, kinetic: ArrayLike = 1.0) -> Floats:
        """Temperature [K] of the gas at the ratio `fuel_to_gas`, any shape."""
        with np.errstate(divide="ignore"):
            log_ratio = np.log(np.asarray(fuel_to_gas, dtype=float))
        (gas,) = bilinear(self.kinetic, self._logarithms[0], [self.gas_K], kinetic, log_ratio)
        return gas

    @cached_property
    def _logarithms(self) -> tuple[Floats, Floats]:
        """Logarithms of B and of the content."""
        return np.log(self.fuel_to_gas), np.log(self.fuel_kg_m3)

    @cached_property
    def _by_content(self) -> tuple[Floats, list[Floats]]:
        """Gas and liquid temperature and ln B over one axis of ln content."""
        ratio, log_content = self._logarithms
        # As fine as the first slice, whose steps are those of B.
        axis = np.union1d(log_content[0], log_content[-1])
        values = (self.gas_K, self.liquid_K, np.broadcast_to(ratio, log_content.shape))
        return axis, [
            np.stack([np.interp(axis, x, y) for x, y in zip(log_content, value, strict=True)])
            for value in values
        ]


def bilinear(
    rows: Floats, columns: Floats, tables: list[Floats], row: ArrayLike, column: ArrayLike
) -> list[Floats]:
    """Values of tables (rows, columns) between their entries, clamped at the ends."""
    i, v = _between(rows, np.asarray(row, dtype=float))
    j, w = _between(columns, np.asarray(column, dtype=float))
    cell = i * len(columns) + j
    results = []
    for table in tables:  # by differences, so that equal entries are met exactly
        flat = table.reshape(-1)  # with two indices numpy would take twice as long
        low, high = (
            (below := flat[at]) + w * (flat[at + 1] - below) for at in (cell, cell + len(columns))
        )
        results.append(np.asarray(low + v * (high - low)))
    return results


def _between(axis: Floats, x: Floats) -> tuple[Ints, Floats]:
    held = np.clip(x, axis[0], axis[-1])
    i = np.clip(np.searchsorted(axis, held) - 1, 0, len(axis) - 2)
    return i, (held - axis[i]) / (axis[i + 1] - axis[i])


def heptane_state(
    fuel_to_gas: ArrayLike, *, pressure_Pa: float, gas_K: float, fuel_K: float
) -> tuple[Floats, Floats]:
    """Temperature and evaporated share of n-heptane in equilibrium with nitrogen, any shape.

    `fuel_to_gas` is B > 0; `gas_K` and `fuel_K` are the temperatures before mixing, with liquid
    fuel. Raises SprayError if the pressure is above the fuel's critical pressure.
    """
    if pressure_Pa >= HEPTANE_CRITICAL_Pa:
        raise SprayError(
            f"spray.ambient.pressure_Pa: {pressure_Pa:g} is above the critical pressure of "
            f"n-heptane; with evaporation the cone model allows less than {HEPTANE_CRITICAL_Pa:g}"
        )
    ratio = np.asarray(fuel_to_gas, dtype=float)
    supply = ratio * heptane_liquid_enthalpy_J_kg(fuel_K) + nitrogen_enthalpy_J_kg(gas_K)

    def share(temperature: Floats) -> Floats:
        """Evaporated share: up to B_sat of saturated nitrogen, or all of the fuel."""
        mole = heptane_saturation_pressure_Pa(temperature) / pressure_Pa
        boiling = (mole >= 1) | (temperature >= HEPTANE_CRITICAL_K)
        mole = np.where(boiling, 0.5, mole)
        taken = HEPTANE_MOLAR_MASS_kg_mol / NITROGEN_MOLAR_MASS_kg_mol * mole / (1 - mole)
        return np.where(boiling, 1.0, np.minimum(1.0, taken / ratio))

    def excess(temperature: Floats) -> Floats:
        f = share(temperature)
        fuel = f * heptane_vapour_enthalpy_J_kg(temperature) + (
            1 - f
        ) * heptane_liquid_enthalpy_J_kg(temperature)
        return np.asarray(ratio * fuel + nitrogen_enthalpy_J_kg(temperature) - supply)

    low = np.full(ratio.shape, 0.4 * min(gas_K, fuel_K))
    high = np.full(ratio.shape, max(gas_K, fuel_K) * (1 + 1e-12))
    temperature = rising_root(excess, low, high)
    return temperature, share(temperature)


def lagging_state(
    fuel_to_gas: ArrayLike,
    evaporated: ArrayLike,
    kernels: DropletKernels,
    *,
    pressure_Pa: float,
    gas_K: float,
    fuel_K: float,
) -> tuple[Floats, Floats]:
    """Temperatures of gas and liquid, any shape, for a given evaporated share of the fuel.

    Enthalpy is conserved, and the liquid has the wet-bulb temperature of the surrounding gas. The
    share is at most that of equilibrium, where both temperatures are those of `heptane_state`.
    """
    ratio, share = np.broadcast_arrays(
        np.asarray(fuel_to_gas, dtype=float), np.asarray(evaporated, dtype=float)
    )
    supply = ratio * heptane_liquid_enthalpy_J_kg(fuel_K) + nitrogen_enthalpy_J_kg(gas_K)
    vapour, liquid = ratio * share, ratio * (1 - share)
    hottest = 2 * max(gas_K, fuel_K)
    gas = np.full(ratio.shape, gas_K)

    def balanced_K(surface: Floats) -> Floats:
        """Temperature of the gas, by Newton's method from the last one; both cp vary slowly."""
        nonlocal gas
        supplied = supply - liquid * heptane_liquid_enthalpy_J_kg(surface)
        for _ in range(2):
            enthalpy = vapour * heptane_vapour_enthalpy_J_kg(gas) + nitrogen_enthalpy_J_kg(gas)
            slope = vapour * heptane_vapour_cp_J_kg_K(gas) + nitrogen_cp_J_kg_K(gas)
            gas = np.clip(gas + (supplied - enthalpy) / slope, 0.3 * gas_K, hottest)
        return gas

    def excess(surface: Floats) -> Floats:
        y = vapour / (1 + vapour)
        hot = balanced_K(surface)
        return -at_rest(surface, kernels, gas_K=hot, vapour_share=y, pressure_Pa=pressure_Pa).heat_W

    low = np.full(ratio.shape, 0.4 * min(gas_K, fuel_K))
    high = np.full(ratio.shape, min(max(gas_K, fuel_K), HEPTANE_CRITICAL_K))
    surface = rising_root(excess, low, high, halvings=30)
    return balanced_K(surface), surface


def heptane_mixture(
    kernels: DropletKernels | None, *, pressure_Pa: float, gas_K: float, fuel_K: float
) -> Mixture:
    """Table of liquid n-heptane in nitrogen; without kernels nothing evaporates, and no heat is
    exchanged."""
    # In the range of liquid steps of B are 4 %, 1e7^(1/399).
    ratio = np.unique(np.concatenate([np.geomspace(1e-9, 1e6, 90), np.geomspace(1e-4, 1e3, 400)]))
    if kernels is None:
        return _table(
            ratio,
            np.array([0.0, 1.0]),
            np.zeros(ratio.shape),
            np.full((2, len(ratio)), gas_K),
            np.full((2, len(ratio)), fuel_K),
            pressure_Pa=pressure_Pa,
        )
    conditions = {"pressure_Pa": pressure_Pa, "gas_K": gas_K, "fuel_K": fuel_K}
    saturation_B, saturation_K = _saturation(**conditions), float("nan")
    if np.isfinite(saturation_B):
        ratio = np.unique(np.append(ratio, saturation_B))
    temperature, equilibrium = heptane_state(ratio, **conditions)
    if np.isfinite(saturation_B):
        saturation_K = float(temperature[np.searchsorted(ratio, saturation_B)])
    kinetic = np.linspace(0.0, 1.0, _SLICES) ** 2
    gas, liquid = (np.tile(temperature, (_SLICES, 1)) for _ in range(2))
    evaporated = np.minimum(kinetic[:, None], equilibrium)
    # Dry states have a wet bulb too, for interpolation between dry and wet states.
    lags = (evaporated < equilibrium) | (equilibrium == 1)
    gas[lags], liquid[lags] = lagging_state(
        np.broadcast_to(ratio, lags.shape)[lags], evaporated[lags], kernels, **conditions
    )
    return _table(
        ratio,
        kinetic,
        equilibrium,
        gas,
        liquid,
        pressure_Pa=pressure_Pa,
        saturation_B=saturation_B,
        saturation_K=saturation_K,
    )


def _table(
    ratio: Floats,
    kinetic: Floats,
    equilibrium: Floats,
    gas_K: Floats,
    liquid_K: Floats,
    *,
    pressure_Pa: float,
    saturation_B: float = float("nan"),
    saturation_K: float = float("nan"),
) -> Mixture:
    evaporated = np.minimum(kinetic[:, None], equilibrium)
    per_pascal = GAS_CONSTANT_J_mol_K * gas_K / pressure_Pa
    volume = (  # of the mixture, per mass of fuel
        evaporated * per_pascal / HEPTANE_MOLAR_MASS_kg_mol
        + per_pascal / (NITROGEN_MOLAR_MASS_kg_mol * ratio)
        + (1 - evaporated) / heptane_density_kg_m3(liquid_K)
    )
    return Mixture(
        ratio, kinetic, equilibrium, 1 / volume, gas_K, liquid_K, saturation_B, saturation_K
    )


def _saturation(**conditions: float) -> float:
    """Ratio B at which the last liquid evaporates, from tables of increasing resolution."""
    low, high, steps = 1e-9, 1e6, 299
    zooms = np.log(np.log(high / low) / np.finfo(float).eps) / np.log(steps)  # down to rounding
    for _ in range(int(np.ceil(zooms))):
        ratio = np.geomspace(low, high, steps + 1)
        _, share = heptane_state(ratio, **conditions)
        index = int(np.argmax(share < 1))
        if share[index] == 1 or index == 0:
            return float("nan")  # all or none evaporates in every mixture
        low, high = ratio[index - 1], ratio[index]
    return float(low)
