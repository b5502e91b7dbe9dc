"""The gas film around an evaporating n-heptane droplet: wet bulb and rate of the d^2 law.

Film theory for a droplet at rest in its gas, as Abramzon and Sirignano (1989) have it for Re = 0:
mdot = 2 pi d rho D ln(1 + BM), BT = (1 + BM)^phi - 1 with phi = cp_F rho D / lambda, and at the wet
bulb no heat enters the liquid: cp_F (T_gas - T_s) = BT L. Properties at a third of the way from
surface to gas. Slip between droplet and gas, which speeds evaporation up, is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.spray.fuel import (
    HEPTANE_CRITICAL_K,
    NITROGEN,
    GAS_CONSTANT_J_mol_K,
    HEPTANE_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_diffusivity_m2_s,
    heptane_liquid_cp_J_kg_K,
    heptane_liquid_enthalpy_J_kg,
    heptane_saturation_pressure_Pa,
    heptane_vapour_conductivity_W_m_K,
    heptane_vapour_cp_J_kg_K,
    heptane_vapour_enthalpy_J_kg,
    nitrogen_conductivity_W_m_K,
)

Floats = NDArray[np.float64]

_FILM = 1 / 3  # where between surface and gas the film's properties are taken
_HALVINGS = 40
_POINTS = 400


@dataclass(frozen=True)
class Film:
    """All (N,). mass_kg_m_s: rho D ln(1 + BM); heat_excess: above 0 the surface cools.

    heat_J_kg: what is conducted to the surface for each mass that leaves it,
    cp_F (T_gas - T_s) / BT.
    """

    mass_kg_m_s: Floats
    heat_excess: Floats
    heat_J_kg: Floats


def film(
    surface_K: ArrayLike, *, gas_K: ArrayLike, vapour_share: ArrayLike, pressure_Pa: float
) -> Film:
    """State of the film; `vapour_share` is the gas's mass fraction of fuel vapour, 0..1.

    heat_excess is phi ln(1 + BM) - ln(1 + cp_F (T_gas - T_s) / L): it rises with the surface's
    temperature and is 0 at the wet bulb. At and above boiling rate and excess are infinite.
    """
    surface, gas = np.asarray(surface_K, dtype=float), np.asarray(gas_K, dtype=float)
    far = np.asarray(vapour_share, dtype=float)
    mole = heptane_saturation_pressure_Pa(surface) / pressure_Pa
    boiling = (mole >= 1) | (surface >= HEPTANE_CRITICAL_K)
    mole = np.where(boiling, 0.5, mole)
    heavy, light = HEPTANE_MOLAR_MASS_kg_mol, NITROGEN.molar_mass_kg_mol
    near = mole * heavy / (mole * heavy + (1 - mole) * light)
    transfer = np.log((1 - far) / (1 - near))  # ln(1 + BM)
    t = surface + _FILM * (gas - surface)
    y = near + _FILM * (far - near)
    moles = y / heavy + (1 - y) / light
    rho = pressure_Pa / (GAS_CONSTANT_J_mol_K * t * moles)
    rho_d = rho * heptane_diffusivity_m2_s(t, pressure_Pa=pressure_Pa)
    vapour_cp = heptane_vapour_cp_J_kg_K(t)
    conductivity = y * heptane_vapour_conductivity_W_m_K(t)
    conductivity = conductivity + (1 - y) * nitrogen_conductivity_W_m_K(t)  # by mass
    latent = heptane_vapour_enthalpy_J_kg(surface) - heptane_liquid_enthalpy_J_kg(surface)
    # Gas far below the surface's temperature gives no bound: any positive number will do.
    driving = np.maximum(1 + vapour_cp * (gas - surface) / latent, 1e-6)
    blowing = vapour_cp * rho_d / conductivity * transfer  # ln(1 + BT)
    with np.errstate(divide="ignore", invalid="ignore"):
        heat = vapour_cp * (gas - surface) / np.expm1(blowing)
    return Film(
        np.where(boiling, np.inf, rho_d * transfer),
        np.where(boiling, np.inf, blowing - np.log(driving)),
        np.where(boiling, 0.0, heat),
    )


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
    """The gas is fuel-free and far away; below the critical pressure of the fuel.

    With q the conducted heat a mass, dm/m = cp dT / (L - q) on the way to the wet bulb. What this
    is more or less than the steady rate would have taken in the same time goes into `start`.
    """
    far = {"gas_K": gas_K, "vapour_share": 0.0, "pressure_Pa": pressure_Pa}
    low, high = 0.4 * gas_K, max(gas_K, HEPTANE_CRITICAL_K)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if film(middle, **far).heat_excess > 0 else (middle, high)
    steady = float(film(low, **far).mass_kg_m_s)
    rate = 8 * steady / float(heptane_density_kg_m3(low))
    way = fuel_K + (low - fuel_K) * (np.arange(_POINTS) + 0.5) / _POINTS
    state = film(way, **far)
    latent = heptane_vapour_enthalpy_J_kg(way) - heptane_liquid_enthalpy_J_kg(way)
    slope = heptane_liquid_cp_J_kg_K(way) * (1 - steady / state.mass_kg_m_s)
    change = float(np.mean(slope / (latent - state.heat_J_kg))) * (low - fuel_K)
    return WetBulb(low, rate, float(np.exp(2 / 3 * change)))
