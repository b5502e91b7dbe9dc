"""Fuels and carrier gases as fast tables, built once and cached on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K
from cldit.errors import SprayError
from cldit.io.tables import Arrays, cached
from cldit.spray.bisection import rising_root
from cldit.spray.droplet.curves import Curves, curves
from cldit.spray.droplet.fits import gas_fits, liquid_fits
from cldit.spray.droplet.substances import fuel_columns, gas_columns

_FORM = "fluid table 3"
# Of the gas, which may be above the critical pressure of a droplet that is below its critical
# temperature.
HIGHEST_Pa = 10e6


@dataclass(frozen=True)
class Gas:
    """Carrier gas: ideal, with cp, conductivity, viscosity and enthalpy in `vapour`."""

    name: str
    molar_mass_kg_mol: float
    diffusion_volume: float
    critical_K: float
    critical_Pa: float
    vapour: Curves

    @cached_property
    def vapour_fits(self) -> tuple[Floats, Floats]:
        """See `fits.gas_fits`."""
        return gas_fits(self.name, self.vapour)


@dataclass(frozen=True)
class Fuel(Gas):
    """Fuel: its dilute vapour, and its liquid at saturation.

    Between its grid points a table is within 1e-5 of its source. `liquid` ends at 0.98 of the
    critical temperature (530.4 K for n-heptane).
    """

    liquid: Curves

    @cached_property
    def liquid_fits(self) -> tuple[Floats, Floats]:
        """See `fits.liquid_fits`."""
        return liquid_fits(self.name, self.liquid, critical_K=self.critical_K)

    def boiling_K(self, pressure_Pa: ArrayLike) -> Floats:
        """Boiling temperature, any shape, by bisection within the table."""
        ln_pressure = np.log(np.asarray(pressure_Pa, dtype=float))
        low = np.full(ln_pressure.shape, self.liquid.low_K)
        high = np.full(ln_pressure.shape, self.liquid.high_K)

        def excess(temperature_K: Floats) -> Floats:
            return np.asarray(self.liquid.value("ln_psat", temperature_K) - ln_pressure)

        return rising_root(excess, low, high, halvings=48)  # 500 K down to 2e-12 K

    def diameter_m(self, mass_kg: ArrayLike, temperature_K: ArrayLike) -> Floats:
        """Diameter of a droplet of a given mass and temperature, any shape."""
        volume = np.asarray(mass_kg) / self.liquid.value("density", temperature_K)
        return np.asarray(np.cbrt(6 / np.pi * volume))

    def mass_kg(self, diameter_m: ArrayLike, temperature_K: ArrayLike) -> Floats:
        """Mass of a droplet of a given diameter and temperature, any shape."""
        d = np.asarray(diameter_m, dtype=float)
        return np.asarray(np.pi / 6 * d**3 * self.liquid.value("density", temperature_K))


def diffusivity_m2_s(
    fuel: Fuel, gas: Gas, *, temperature_K: ArrayLike, pressure_Pa: ArrayLike
) -> Floats:
    """Diffusivity in a dilute binary mixture, any shape.

    See Fuller, Ensley and Giddings, J. Phys. Chem. 73, 3679 (1969).
    """
    mass = 2e3 / (1 / fuel.molar_mass_kg_mol + 1 / gas.molar_mass_kg_mol)
    size = np.cbrt(fuel.diffusion_volume) + np.cbrt(gas.diffusion_volume)
    # The published 0.00143 is for cm2/s and bar.
    factor = 0.00143e-4 * 1e5 / (np.sqrt(mass) * size * size)
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(factor * t**1.75 / np.asarray(pressure_Pa))


def property_table(fuel: Fuel, gas: Gas) -> Floats:
    """Table of kernels/spray/droplet_properties.h: constants, ranges, polynomials."""
    lighter = gas.molar_mass_kg_mol / fuel.molar_mass_kg_mol
    diffusion = float(diffusivity_m2_s(fuel, gas, temperature_K=1.0, pressure_Pa=1.0))
    constants = [
        1 / fuel.molar_mass_kg_mol,
        1 / gas.molar_mass_kg_mol,
        lighter,
        lighter**0.25,
        1 / np.sqrt(8 * (1 + 1 / lighter)),
        diffusion / GAS_CONSTANT_J_mol_K,
        1 / fuel.critical_K,
    ]
    fits = (fuel.liquid_fits, fuel.vapour_fits, gas.vapour_fits)
    return np.concatenate([constants, *(ends for ends, _ in fits), *(rows for _, rows in fits)])


def fuel_table(name: str, *, cache: Path | None) -> Fuel:
    """Fuel by name: iso-octane, or a fluid of CoolProp that consists of C, H and O.

    `cache` is the folder of tables; None: no cache. Raises SprayError if the fuel is unknown, or
    lacks properties that evaporation needs.
    """
    arrays = _cached(f"fuel {name.casefold()}", lambda: fuel_columns(name), cache)
    phases = _curves(arrays, "vapour"), _curves(arrays, "liquid")
    return Fuel(name=name, **_constants(arrays), vapour=phases[0], liquid=phases[1])


def gas_table(name: str, *, cache: Path | None) -> Gas:
    """Carrier gas by name, one of `substances.GASES`; `cache` as in `fuel_table`."""
    arrays = _cached(f"gas {name.casefold()}", lambda: gas_columns(name), cache)
    return Gas(name=name, **_constants(arrays), vapour=_curves(arrays, "vapour"))


def check_conditions(
    fuel: Fuel,
    *,
    temperature_K: float,
    gas_K: float,
    pressure_Pa: float,
    names: tuple[str, str, str] = ("droplet temperature", "gas temperature", "pressure"),
) -> None:
    """Raises SprayError if a droplet or its gas is outside the tables; `names` are in its text."""
    low, high = fuel.liquid.low_K, fuel.liquid.high_K
    if not low <= temperature_K <= high:
        above = "supercritical or close to it" if temperature_K > high else "frozen"
        raise SprayError(
            f"{names[0]} {temperature_K:g} K: {fuel.name} would be {above}; allowed: "
            f"{low:.0f} to {high:.1f} K"
        )
    check_gas(fuel, gas_K=gas_K, pressure_Pa=pressure_Pa, names=names[1:])


def check_gas(fuel: Fuel, *, gas_K: float, pressure_Pa: float, names: tuple[str, str]) -> None:
    """Raises SprayError if the gas is outside the tables; `names` are in its text."""
    if not 100.0 <= gas_K <= fuel.vapour.high_K:
        raise SprayError(f"{names[0]} {gas_K:g} K; allowed: 100 to {fuel.vapour.high_K:.0f} K")
    if not 1e3 <= pressure_Pa <= HIGHEST_Pa:
        raise SprayError(
            f"{names[1]} {pressure_Pa:g} Pa; allowed: 1 kPa to {HIGHEST_Pa / 1e6:.0f} MPa, up to "
            "which the gases are ideal within some percent"
        )


def _cached(key: str, build: Callable[[], Arrays], cache: Path | None) -> Arrays:
    return cached(
        cache, kind="fluid", description=f"{_FORM} {version('CoolProp')} {key}", make=build
    )


def _constants(arrays: Arrays) -> dict[str, float]:
    """The numbers of `Gas` by name."""
    names = ("molar_mass_kg_mol", "diffusion_volume", "critical_K", "critical_Pa")
    return {name: float(arrays[f"constants.{name}"]) for name in names}


def _curves(arrays: Arrays, phase: str) -> Curves:
    columns = {name: array for name, array in arrays.items() if name.startswith(f"{phase}.")}
    values = {name.partition(".")[2]: column for name, column in columns.items()}
    return curves(arrays[f"{phase}_K."], values)
