"""Droplets of n-heptane at rest, for the `cone` spray: wet bulb and rate of the d^2 law.

The film is that of `cldit.spray.droplet` (Spalding's, which at rest is Abramzon and Sirignano's),
with the property fits that the cone's mixtures have (`fluid_properties.py`), so that a droplet in
saturated gas is in equilibrium. Slip, which speeds evaporation up, is left out.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.spray.cone.fluid_properties import (
    HEPTANE_CRITICAL_K,
    HEPTANE_DIFFUSION_VOLUME,
    NITROGEN,
    NITROGEN_DIFFUSION_VOLUME,
    HEPTANE_CRITICAL_Pa,
    HEPTANE_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_latent_heat_J_kg,
    heptane_liquid_conductivity_W_m_K,
    heptane_liquid_cp_J_kg_K,
    heptane_saturation_pressure_Pa,
    heptane_vapour_conductivity_W_m_K,
    heptane_vapour_cp_J_kg_K,
    heptane_vapour_viscosity_Pa_s,
    nitrogen_conductivity_W_m_K,
    nitrogen_viscosity_Pa_s,
)
from cldit.spray.droplet.curves import curves
from cldit.spray.droplet.evaporation import Drop, Rates, spalding
from cldit.spray.droplet.fluids import Fuel, Gas

Floats = NDArray[np.float64]

_SIZE_m = 10e-6  # any: at rest both rates are proportional to it
_HALVINGS = 40
_POINTS = 400


@functools.cache
def _fluids() -> tuple[Fuel, Gas]:
    """The fits as the tables that evaporation models read."""
    cold = np.linspace(180.0, 535.0, 711)
    gas = np.linspace(100.0, 3100.0, 3001)
    liquid = {
        "ln_psat": np.log(heptane_saturation_pressure_Pa(cold)),
        "density": heptane_density_kg_m3(cold),
        "cp": heptane_liquid_cp_J_kg_K(cold),
        "latent": heptane_latent_heat_J_kg(cold),
        "conductivity": heptane_liquid_conductivity_W_m_K(cold),
    }
    fuel = Fuel(
        name="n-heptane",
        molar_mass_kg_mol=HEPTANE_MOLAR_MASS_kg_mol,
        diffusion_volume=HEPTANE_DIFFUSION_VOLUME,
        critical_K=HEPTANE_CRITICAL_K,
        critical_Pa=HEPTANE_CRITICAL_Pa,
        vapour=curves(
            gas,
            {
                "cp": heptane_vapour_cp_J_kg_K(gas),
                "conductivity": heptane_vapour_conductivity_W_m_K(gas),
                "viscosity": heptane_vapour_viscosity_Pa_s(gas),
            },
        ),
        liquid=curves(cold, liquid),
    )
    carrier = Gas(
        name="nitrogen",
        molar_mass_kg_mol=NITROGEN.molar_mass_kg_mol,
        diffusion_volume=NITROGEN_DIFFUSION_VOLUME,
        critical_K=126.2,
        critical_Pa=3.396e6,
        vapour=curves(
            gas,
            {
                "cp": NITROGEN.cp_J_kg_K(gas),
                "conductivity": nitrogen_conductivity_W_m_K(gas),
                "viscosity": nitrogen_viscosity_Pa_s(gas),
            },
        ),
    )
    return fuel, carrier


def still(
    surface_K: ArrayLike, *, gas_K: ArrayLike, vapour_share: ArrayLike, pressure_Pa: float
) -> Rates:
    """Rates of droplets of 10 um at rest; heat into the liquid is 0 at the wet bulb.

    Args:
        surface_K, gas_K: temperatures, any shape.
        vapour_share: mass fraction of fuel in the gas, any shape.
        pressure_Pa: of the gas.
    """
    fuel, carrier = _fluids()
    columns = np.broadcast_arrays(_SIZE_m, surface_K, gas_K, pressure_Pa, vapour_share, 0.0)
    shape = columns[0].shape
    found = spalding(Drop(fuel, carrier, *(np.ravel(each).astype(float) for each in columns)))
    return Rates(found.mass_kg_s.reshape(shape), found.heat_W.reshape(shape))


@dataclass(frozen=True)
class WetBulb:
    """Steady evaporation of a droplet in gas without vapour.

    rate_m2_s: K, by which d^2 falls with time.
    start: s0 of d^2 / d0^2 = s0 - K t / d0^2, that holds once the droplet has its wet bulb: above
    1 where it must be heated to it (taken as whole while the sum is above 1), below 1 where it
    comes warmer and its own heat evaporates a share (taken at once).
    """

    temperature_K: float
    rate_m2_s: float
    start: float


def wet_bulb(*, gas_K: float, pressure_Pa: float, fuel_K: float) -> WetBulb:
    """The wet bulb in fuel-free gas far away, below the critical pressure of the fuel.

    With Q the heat into the liquid, dm/m = cp dT mdot/Q on the way to the wet bulb. What this is
    more or less than the steady rate would have taken in the same time goes into `start`.

    Args:
        gas_K, pressure_Pa: of the gas.
        fuel_K: temperature of the fuel at the start.
    """

    def at(surface_K: ArrayLike) -> Rates:
        return still(surface_K, gas_K=gas_K, vapour_share=0.0, pressure_Pa=pressure_Pa)

    low, high = 0.4 * gas_K, max(gas_K, HEPTANE_CRITICAL_K)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle).heat_W > 0 else (low, middle)
    steady = float(at(low).mass_kg_s)
    rate = 4 * steady / (np.pi * _SIZE_m * float(heptane_density_kg_m3(low)))
    way = fuel_K + (low - fuel_K) * (np.arange(_POINTS) + 0.5) / _POINTS
    there = at(way)
    slope = heptane_liquid_cp_J_kg_K(way) * (steady - there.mass_kg_s) / there.heat_W
    change = float(np.mean(slope)) * (low - fuel_K)
    return WetBulb(low, rate, float(np.exp(2 / 3 * change)))
