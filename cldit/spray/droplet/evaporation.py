"""Evaporation models: how fast a droplet loses mass, and how much heat enters its liquid.

A model is a function of a `Drop` that returns `Rates`; another one is one function and one line in
`MODELS`. All are driven by the mass transfer number, so that a gas colder than the fuel still
evaporates it, and all are bounded at boiling.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cldit.spray.droplet.curves import Floats
from cldit.spray.droplet.fluids import Fuel, Gas, diffusivity_m2_s
from cldit.spray.droplet.substances import GAS_CONSTANT_J_mol_K

# Of the fuel's mole fraction at the surface. A superheated droplet evaporates as fast as this
# allows, ln(1 + B) = 7 to 8, and cools to boiling at once.
_MOST_VAPOUR = 0.999
_MOST_FAR_VAPOUR = 0.99  # of it far away: below the former, so that whatever boils evaporates


@dataclass(frozen=True)
class Drop:
    """Droplets and the gas far from each; all (N,).

    temperature_K: of the liquid, uniform. vapour: mass fraction of fuel in the gas.
    slip_m_s: speed of the droplet relative to the gas.
    """

    fuel: Fuel
    gas: Gas
    diameter_m: Floats
    temperature_K: Floats
    gas_temperature_K: Floats
    pressure_Pa: Floats
    vapour: Floats
    slip_m_s: Floats


@dataclass(frozen=True)
class Rates:
    """All (N,). mass_kg_s: evaporating, negative when vapour condenses. heat_W: into the liquid."""

    mass_kg_s: Floats
    heat_W: Floats


Model = Callable[[Drop], Rates]


@dataclass(frozen=True)
class Film:
    """The gas around a droplet at its reference state; all (N,).

    transfer: mass transfer number BM. density_kg_m3: far from the droplet.
    cp_vapour_J_kg_K: of the fuel's vapour. diffusion_kg_m_s: density times diffusivity.
    """

    transfer: Floats
    density_kg_m3: Floats
    viscosity_Pa_s: Floats
    reynolds: Floats
    prandtl: Floats
    schmidt: Floats
    cp_J_kg_K: Floats
    cp_vapour_J_kg_K: Floats
    conductivity_W_m_K: Floats
    diffusion_kg_m_s: Floats


def surface_vapour(drop: Drop) -> Floats:
    """Mass fraction of fuel at the surface (Raoult's law, capped at boiling)."""
    part = drop.fuel.saturation_Pa(drop.temperature_K) / drop.pressure_Pa
    return np.asarray(_mass_fraction(drop, np.minimum(part, _MOST_VAPOUR)))


def _mass_fraction(drop: Drop, moles: Floats | float) -> Floats | float:
    ratio = drop.gas.molar_mass_kg_mol / drop.fuel.molar_mass_kg_mol
    return moles / (moles + (1 - moles) * ratio)


def film(drop: Drop, *, share: float = 1 / 3) -> Film:
    """Film at `share` of the way from the surface to the gas, in temperature and composition.

    Wilke's mixing rule for viscosity and conductivity; ideal gases.
    """
    fuel, gas = drop.fuel, drop.gas
    surface = surface_vapour(drop)
    t = drop.temperature_K + share * (drop.gas_temperature_K - drop.temperature_K)
    distant = np.minimum(drop.vapour, _mass_fraction(drop, _MOST_FAR_VAPOUR))
    y = surface + share * (distant - surface)
    cp_v, lam_v, mu_v = fuel.vapour.at(t, "cp", "conductivity", "viscosity")
    cp_g, lam_g, mu_g = gas.vapour.at(t, "cp", "conductivity", "viscosity")
    heavy = gas.molar_mass_kg_mol / fuel.molar_mass_kg_mol
    x = y * heavy / (y * heavy + 1 - y)
    # Wilke: phi_vg = (1 + sqrt(mu_v/mu_g) (Mg/Mv)^1/4)^2 / sqrt(8 (1 + Mv/Mg)); phi_gv from it.
    phi_vg = (1 + np.sqrt(mu_v / mu_g) * heavy**0.25) ** 2 / np.sqrt(8 * (1 + 1 / heavy))
    phi_gv = phi_vg * mu_g / mu_v / heavy
    of_v, of_g = x / (x + (1 - x) * phi_vg), (1 - x) / (1 - x + x * phi_gv)
    viscosity = of_v * mu_v + of_g * mu_g
    conductivity = of_v * lam_v + of_g * lam_g
    cp = y * cp_v + (1 - y) * cp_g
    diffusion = _density(drop, t, y) * diffusivity_m2_s(
        fuel, gas, temperature_K=t, pressure_Pa=drop.pressure_Pa
    )
    far = _density(drop, drop.gas_temperature_K, drop.vapour)
    return Film(
        transfer=(surface - distant) / (1 - surface),
        density_kg_m3=far,
        viscosity_Pa_s=viscosity,
        reynolds=far * drop.slip_m_s * drop.diameter_m / viscosity,
        prandtl=viscosity * cp / conductivity,
        schmidt=viscosity / diffusion,
        cp_J_kg_K=cp,
        cp_vapour_J_kg_K=cp_v,
        conductivity_W_m_K=conductivity,
        diffusion_kg_m_s=diffusion,
    )


def _density(drop: Drop, temperature_K: Floats, vapour: Floats) -> Floats:
    moles_kg = vapour / drop.fuel.molar_mass_kg_mol + (1 - vapour) / drop.gas.molar_mass_kg_mol
    return drop.pressure_Pa / (GAS_CONSTANT_J_mol_K * temperature_K * moles_kg)


def spalding(drop: Drop) -> Rates:
    """Film theory (Spalding 1953), Ranz-Marshall, heat flux with blowing; film at one third."""
    state = film(drop)
    sherwood = _ranz_marshall(state.reynolds, state.schmidt)
    mass = np.pi * drop.diameter_m * state.diffusion_kg_m_s * sherwood * np.log1p(state.transfer)
    return _with_heat(drop, state, mass, _ranz_marshall(state.reynolds, state.prandtl))


def abramzon_sirignano(drop: Drop) -> Rates:
    """Abramzon and Sirignano, Int. J. Heat Mass Transfer 32, 1605 (1989): film theory whose films
    thicken with blowing; Clift's correlation for the droplet without blowing."""
    state = film(drop)
    moving = bool(np.any(state.reynolds > 0))
    blowing = np.log1p(state.transfer)
    sherwood = np.full_like(blowing, 2.0)
    nusselt = sherwood
    if moving:
        sherwood = 2 + (_clift(state.reynolds, state.schmidt) - 2) / _thickening(blowing)
    mass = np.pi * drop.diameter_m * state.diffusion_kg_m_s * sherwood * blowing
    if moving:
        still = _clift(state.reynolds, state.prandtl) - 2
        # ln(1 + BT) = mass cp_v / (pi d lam Nu*), and Nu* = 2 + (Nu0 - 2)/F(BT): a contraction,
        # for F hardly changes with BT.
        bare = mass * state.cp_vapour_J_kg_K / (np.pi * drop.diameter_m * state.conductivity_W_m_K)
        nusselt = 2 + still / _thickening(bare / (2 + still))
        for _ in range(40):
            before, nusselt = nusselt, 2 + still / _thickening(bare / nusselt)
            if np.all(np.abs(nusselt - before) <= 1e-9 * nusselt):
                break
    return _with_heat(drop, state, mass, nusselt)


def dukowicz(drop: Drop) -> Rates:
    """Dukowicz, LA-7997-MS (1979), Le = 1, in the form without 0/0 at equal temperatures:
    pi d Nu (lam/cp_gas) BM. Linear in BM; film half way."""
    mass, heat, _ = _dukowicz(drop)
    return Rates(mass, heat)


def dukowicz_logarithmic(drop: Drop) -> Rates:
    """`dukowicz` with ln(1 + B)/B on both fluxes, as several codes have it."""
    mass, heat, number = _dukowicz(drop)
    safe = np.where(np.abs(number) < 1e-12, 1e-12, number)
    weaker = np.log1p(safe) / safe
    return Rates(mass * weaker, heat * weaker)


def _dukowicz(drop: Drop) -> tuple[Floats, Floats, Floats]:
    """Both rates without the logarithm, and the transfer number."""
    state = film(drop, share=0.5)
    nusselt = _ranz_marshall(state.reynolds, state.prandtl)
    middle = 0.5 * (drop.temperature_K + drop.gas_temperature_K)
    cp_far = drop.vapour * drop.fuel.vapour.one("cp", middle)
    cp_far += (1 - drop.vapour) * drop.gas.vapour.one("cp", middle)
    bare = np.pi * drop.diameter_m * state.conductivity_W_m_K * nusselt
    mass = np.asarray(bare / cp_far * state.transfer)
    convection = bare * (drop.gas_temperature_K - drop.temperature_K)
    return mass, np.asarray(convection - mass * _latent(drop)), state.transfer


def frolov_type(drop: Drop) -> Rates:
    """Film theory outside, finite conductivity inside: a parabolic profile of temperature, so that
    the surface is at T + heat / (10 pi k d).

    In the manner of Frolov, Frolov and Basara (2006), whose own formulation was not at hand.
    """
    conductance = 10 * np.pi * drop.diameter_m
    conductance = conductance * drop.fuel.liquid.one("conductivity", drop.temperature_K)

    def residual(surface_K: Floats) -> tuple[Floats, Rates]:
        rates = spalding(replace(drop, temperature_K=surface_K))
        return surface_K - drop.temperature_K - rates.heat_W / conductance, rates

    # The residual rises with the surface temperature: secants, kept inside a bracket.
    low = np.full_like(drop.temperature_K, drop.fuel.liquid.low_K)
    high = np.full_like(low, drop.fuel.liquid.high_K)
    before, (value_before, rates) = drop.temperature_K, residual(drop.temperature_K)
    at = np.clip(before - 0.5 * value_before, low, high)
    done = np.zeros(at.shape, dtype=bool)
    for _ in range(60):
        value, rates = residual(at)
        low, high = np.where(value < 0, at, low), np.where(value < 0, high, at)
        change = value - value_before
        slope = np.where(change == 0, 1.0, change) / np.where(at == before, 1.0, at - before)
        move = value / np.where(slope > 1e-3, slope, 1.0)
        done |= (np.abs(move) <= 1e-9) | (high - low <= 1e-9)
        if np.all(done):
            break
        target = at - move
        inside = (target > low) & (target < high)
        before, value_before = at, value
        at = np.where(done, at, np.where(inside, target, 0.5 * (low + high)))
    return rates


def _with_heat(drop: Drop, state: Film, mass: Floats, nusselt: Floats) -> Rates:
    """Convection weakened by the blowing vapour, b/(exp b - 1), less the latent heat."""
    bare = np.pi * drop.diameter_m * state.conductivity_W_m_K * nusselt
    b = mass * state.cp_vapour_J_kg_K / bare
    safe = np.where(np.abs(b) < 1e-12, 1e-12, b)
    heat = bare * (drop.gas_temperature_K - drop.temperature_K) * safe / np.expm1(safe)
    return Rates(np.asarray(mass), np.asarray(heat - mass * _latent(drop)))


def _latent(drop: Drop) -> Floats:
    return drop.fuel.liquid.one("latent", drop.temperature_K)


def _ranz_marshall(reynolds: Floats, number: Floats) -> Floats:
    return np.asarray(2 + 0.6 * np.sqrt(reynolds) * np.cbrt(number))


def _clift(reynolds: Floats, number: Floats) -> Floats:
    rise = np.clip(reynolds, 1.0, 400.0) ** 0.077
    return np.asarray(1 + np.cbrt(1 + reynolds * number) * rise)


def _thickening(blowing: Floats) -> Floats:
    """F(B) = (1 + B)^0.7 ln(1 + B)/B as a function of ln(1 + B)."""
    safe = np.where(np.abs(blowing) < 1e-12, 1e-12, blowing)
    return np.asarray(np.exp(0.7 * safe) * safe / np.expm1(safe))


MODELS: dict[str, Model] = {
    "abramzon-sirignano": abramzon_sirignano,
    "spalding": spalding,
    "dukowicz": dukowicz,
    "dukowicz-log": dukowicz_logarithmic,
    "frolov-type": frolov_type,
}
