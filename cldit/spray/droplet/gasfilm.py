"""Gas film around one droplet at its reference state, compiled for the cone."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from cldit.arrays import Floats
from cldit.spray.droplet.curves import Curves
from cldit.spray.droplet.fluids import Fuel, Gas, diffusivity_m2_s
from cldit.spray.droplet.substances import GAS_CONSTANT_J_mol_K
from cldit.spray.numba_typing import compiled

# Largest mole fraction of fuel at the surface. It limits the evaporation of a superheated droplet,
# ln(1 + B) = 7 to 8, which cools to boiling immediately.
_MOST_VAPOUR = 0.999
_MOST_FAR_VAPOUR = 0.99  # the same far away; smaller, so that a boiling droplet evaporates

_LIQUID = ("ln_psat", "density", "cp", "latent")
_VAPOUR = ("cp", "conductivity", "viscosity")
LN_PSAT, DENSITY, CP, LATENT = range(4)


class Tables(NamedTuple):
    """Tables of a fuel and a carrier gas for compiled code.

    liquid, vapour, carrier: cubics, (intervals, properties, 4), from *_low_K on in *_step_K;
    diffusion: `diffusivity_m2_s` at 1 K and 1 Pa.
    """

    liquid: Floats
    vapour: Floats
    carrier: Floats
    liquid_low_K: float
    liquid_high_K: float
    liquid_step_K: float
    vapour_low_K: float
    vapour_step_K: float
    carrier_low_K: float
    carrier_step_K: float
    fuel_kg_mol: float
    gas_kg_mol: float
    diffusion: float


class Here(NamedTuple):
    """One droplet and the gas far from it, as `evaporation.Drop`."""

    diameter_m: float
    temperature_K: float
    gas_temperature_K: float
    pressure_Pa: float
    vapour: float
    slip_m_s: float


class FilmState(NamedTuple):
    """Film of one droplet, as `evaporation.Film`."""

    transfer: float
    density_kg_m3: float
    viscosity_Pa_s: float
    reynolds: float
    prandtl: float
    schmidt: float
    cp_J_kg_K: float
    cp_vapour_J_kg_K: float
    conductivity_W_m_K: float
    diffusion_kg_m_s: float


types: Any = numba.types  # without annotations of its own
_CUBICS = types.Array(types.float64, 3, "C")
TABLES = types.NamedTuple([_CUBICS] * 3 + [types.float64] * 10, Tables)
HERE = types.NamedUniTuple(types.float64, 6, Here)


def tables(fuel: Fuel, gas: Gas) -> Tables:
    """Property tables of a fuel and a carrier gas for compiled code."""
    liquid, vapour, carrier = fuel.liquid, fuel.vapour, gas.vapour
    return Tables(
        liquid=_packed(liquid, _LIQUID),
        vapour=_packed(vapour, _VAPOUR),
        carrier=_packed(carrier, _VAPOUR),
        liquid_low_K=liquid.low_K,
        liquid_high_K=liquid.high_K,
        liquid_step_K=liquid.step_K,
        vapour_low_K=vapour.low_K,
        vapour_step_K=vapour.step_K,
        carrier_low_K=carrier.low_K,
        carrier_step_K=carrier.step_K,
        fuel_kg_mol=fuel.molar_mass_kg_mol,
        gas_kg_mol=gas.molar_mass_kg_mol,
        diffusion=float(diffusivity_m2_s(fuel, gas, temperature_K=1.0, pressure_Pa=1.0)),
    )


@compiled
def place(at: float, low: float, step: float, count: int) -> tuple[int, float]:
    """Interval of a value on a uniform grid, clamped at its ends, and distance into it.

    The grid starts at `low` and has `count` intervals of length `step`. NaN remains NaN.
    """
    rise = min(at - low, count * step)
    if not rise > 0:
        return 0, (0.0 if at <= low else np.nan)
    cell = min(int(rise * (1 / step)), count - 1)
    return cell, rise - cell * step


@compiled
def cubic(table: Floats, cell: int, column: int, part: float) -> float:
    """Value of property `column` in a table (intervals, properties, 4), at a `place`."""
    c = table[cell, column]
    return float(((c[0] * part + c[1]) * part + c[2]) * part + c[3])


def _packed(curves: Curves, names: tuple[str, ...]) -> Floats:
    """Cubics of the properties, (intervals, properties, 4)."""
    return np.ascontiguousarray(np.stack([curves.coefficients[name].T for name in names], axis=1))


@compiled
def liquid_at(tables: Tables, column: int, temperature_K: float) -> float:
    """Property of the liquid, SI, by its number `column` in `_LIQUID`."""
    cell, part = place(
        temperature_K, tables.liquid_low_K, tables.liquid_step_K, tables.liquid.shape[0]
    )
    return cubic(tables.liquid, cell, column, part)


@compiled
def diameter_m(tables: Tables, mass_kg: float, temperature_K: float) -> float:
    """Diameter of a droplet of a given mass and temperature."""
    volume = mass_kg / liquid_at(tables, DENSITY, temperature_K)
    return float(np.cbrt(6 / np.pi * volume))


@compiled
def _mass_fraction(tables: Tables, moles: float) -> float:
    return moles / (moles + (1 - moles) * tables.gas_kg_mol / tables.fuel_kg_mol)


@compiled
def surface_share(tables: Tables, here: Here) -> float:
    """Mass fraction of fuel at the surface of a droplet (Raoult's law, limited at boiling)."""
    part = np.exp(liquid_at(tables, LN_PSAT, here.temperature_K)) / here.pressure_Pa
    return _mass_fraction(tables, min(part, _MOST_VAPOUR))


@compiled
def _density(tables: Tables, here: Here, temperature_K: float, vapour: float) -> float:
    moles_kg = vapour / tables.fuel_kg_mol + (1 - vapour) / tables.gas_kg_mol
    return here.pressure_Pa / (GAS_CONSTANT_J_mol_K * temperature_K * moles_kg)


@compiled
def film_state(tables: Tables, here: Here, share: float) -> FilmState:
    """Film at a `share` of the way from the surface (0) to the gas (1).

    This holds for temperature and composition. Viscosity and conductivity follow Wilke's mixing
    rule; gases are ideal.
    """
    surface = surface_share(tables, here)
    t = here.temperature_K + share * (here.gas_temperature_K - here.temperature_K)
    distant = min(here.vapour, _mass_fraction(tables, _MOST_FAR_VAPOUR))
    y = surface + share * (distant - surface)
    at, u = place(t, tables.vapour_low_K, tables.vapour_step_K, tables.vapour.shape[0])
    cp_v = cubic(tables.vapour, at, 0, u)
    lam_v = cubic(tables.vapour, at, 1, u)
    mu_v = cubic(tables.vapour, at, 2, u)
    at, u = place(t, tables.carrier_low_K, tables.carrier_step_K, tables.carrier.shape[0])
    cp_g = cubic(tables.carrier, at, 0, u)
    lam_g = cubic(tables.carrier, at, 1, u)
    mu_g = cubic(tables.carrier, at, 2, u)
    heavy = tables.gas_kg_mol / tables.fuel_kg_mol
    x = y * heavy / (y * heavy + 1 - y)
    # Wilke: phi_vg = (1 + sqrt(mu_v/mu_g) (Mg/Mv)^1/4)^2 / sqrt(8 (1 + Mv/Mg)); phi_gv from it.
    phi_vg = (1 + np.sqrt(mu_v / mu_g) * heavy**0.25) ** 2 / np.sqrt(8 * (1 + 1 / heavy))
    phi_gv = phi_vg * mu_g / mu_v / heavy
    of_v, of_g = x / (x + (1 - x) * phi_vg), (1 - x) / (1 - x + x * phi_gv)
    viscosity = of_v * mu_v + of_g * mu_g
    conductivity = of_v * lam_v + of_g * lam_g
    cp = y * cp_v + (1 - y) * cp_g
    diffusion = _density(tables, here, t, y) * tables.diffusion * t**1.75 / here.pressure_Pa
    far = _density(tables, here, here.gas_temperature_K, here.vapour)
    return FilmState(
        (surface - distant) / (1 - surface),
        far,
        viscosity,
        far * here.slip_m_s * here.diameter_m / viscosity,
        viscosity * cp / conductivity,
        viscosity / diffusion,
        cp,
        cp_v,
        conductivity,
        diffusion,
    )
