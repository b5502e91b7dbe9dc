"""NumPy twin, in double precision, of the droplets' kernels: the same physics in plain arithmetic.

Rates are of arrays (N,); where the kernels iterate, roots are bracketed and halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fits import GAS_TERMS, LIQUID_TERMS
from cldit.spray.droplet.fluids import Fuel, Gas, property_table
from cldit.spray.droplet.rates import Drop

Pair = tuple[Floats, Floats]


@dataclass(frozen=True)
class Film:
    """Gas around a droplet at its reference state; all (N,).

    transfer: mass transfer number BM. surface: mass fraction of fuel at the surface (Raoult's law,
    limited at boiling). density_kg_m3: far from the droplet. cp_vapour_J_kg_K: of the fuel's
    vapour. diffusion_kg_m_s: density times diffusivity.
    """

    transfer: Floats
    surface: Floats
    density_kg_m3: Floats
    viscosity_Pa_s: Floats
    reynolds: Floats
    prandtl: Floats
    schmidt: Floats
    cp_J_kg_K: Floats
    cp_vapour_J_kg_K: Floats
    conductivity_W_m_K: Floats
    diffusion_kg_m_s: Floats


def film_on_device(drop: Drop, kernels: DropletKernels, *, share: float = 1 / 3) -> Film:
    """Film of the kernels at a `share` of the way from surface to gas."""
    return Film(*kernels.run("films", drop.columns(), 11, share=share)[0])


@dataclass(frozen=True)
class Properties:
    """Polynomials of the table: of the liquid (6, N), of the vapour and of the carrier (3, N)."""

    table: Floats

    def liquid(self, temperature_K: Floats) -> Floats:
        """ln psat, density, cp, latent heat, conductivity, enthalpy."""
        reduced = self._clipped(7, temperature_K) * self.table[6]
        u = np.cbrt(1 - reduced) * self.table[9] + self.table[10]
        fits = self.table[19 : 19 + 6 * LIQUID_TERMS].reshape(6, LIQUID_TERMS)
        values = np.array([np.polyval(each, u) for each in fits])
        values[0] /= reduced
        return values

    def gas(self, number: int, temperature_K: Floats) -> Floats:
        """cp, conductivity, viscosity of the vapour (0) or the carrier (1)."""
        ends = 11 + 4 * number
        u = np.sqrt(self._clipped(ends, temperature_K)) * self.table[ends + 2]
        first = 19 + 6 * LIQUID_TERMS + number * 3 * GAS_TERMS
        fits = self.table[first : first + 3 * GAS_TERMS].reshape(3, GAS_TERMS)
        return np.array([np.polyval(each, u + self.table[ends + 3]) for each in fits])

    def _clipped(self, ends: int, temperature_K: Floats) -> Floats:
        return np.clip(temperature_K, self.table[ends], self.table[ends + 1])


@dataclass(frozen=True)
class Case:
    """Droplets of a fuel in a carrier gas."""

    fuel: Fuel
    gas: Gas
    drop: Drop

    @cached_property
    def known(self) -> Properties:
        return Properties(property_table(self.fuel, self.gas))


def film(case: Case, share: float = 1 / 3) -> Film:
    """Film at a share of the way from the surface to the gas."""
    drop, known = case.drop, case.known
    heavy = case.fuel.molar_mass_kg_mol / case.gas.molar_mass_kg_mol

    def mass_fraction(moles: Floats | float) -> Floats:
        return np.asarray(moles / (moles + (1 - moles) / heavy))

    def density(kelvin: Floats, fraction: Floats) -> Floats:
        moles = fraction / case.fuel.molar_mass_kg_mol
        moles = moles + (1 - fraction) / case.gas.molar_mass_kg_mol
        return np.asarray(drop.pressure_Pa / (GAS_CONSTANT_J_mol_K * kelvin * moles))

    boiling = np.exp(known.liquid(drop.temperature_K)[0]) / drop.pressure_Pa
    surface = mass_fraction(np.minimum(boiling, 0.999))
    far = np.minimum(drop.vapour, mass_fraction(0.99))
    t = drop.temperature_K + share * (drop.gas_temperature_K - drop.temperature_K)
    y = surface + share * (far - surface)
    (cp_v, lam_v, mu_v), (cp_g, lam_g, mu_g) = known.gas(0, t), known.gas(1, t)
    x = y / (y + (1 - y) * heavy)
    phi_vg = (1 + np.sqrt(mu_v / mu_g) * heavy**-0.25) ** 2 / np.sqrt(8 * (1 + heavy))
    phi_gv = (1 + np.sqrt(mu_g / mu_v) * heavy**0.25) ** 2 / np.sqrt(8 * (1 + 1 / heavy))
    of_v, of_g = x / (x + (1 - x) * phi_vg), (1 - x) / (1 - x + x * phi_gv)
    mu, lam = of_v * mu_v + of_g * mu_g, of_v * lam_v + of_g * lam_g
    cp = y * cp_v + (1 - y) * cp_g
    diffusion = known.table[5] * GAS_CONSTANT_J_mol_K * t**1.75 / drop.pressure_Pa
    diffusion = diffusion * density(t, y)
    outside = density(drop.gas_temperature_K, drop.vapour)
    return Film(
        transfer=(surface - far) / (1 - surface),
        surface=surface,
        density_kg_m3=outside,
        viscosity_Pa_s=mu,
        reynolds=outside * drop.slip_m_s * drop.diameter_m / mu,
        prandtl=mu * cp / lam,
        schmidt=mu / diffusion,
        cp_J_kg_K=cp,
        cp_vapour_J_kg_K=cp_v,
        conductivity_W_m_K=lam,
        diffusion_kg_m_s=diffusion,
    )


def spalding(case: Case) -> Pair:
    drop, state = case.drop, film(case)
    size = np.pi * drop.diameter_m
    sherwood = 2 + 0.6 * np.sqrt(state.reynolds) * np.cbrt(state.schmidt)
    mass = size * state.diffusion_kg_m_s * sherwood * np.log1p(state.transfer)
    return mass, _heat(
        case, state, mass, 2 + 0.6 * np.sqrt(state.reynolds) * np.cbrt(state.prandtl)
    )


def abramzon_sirignano(case: Case) -> Pair:
    drop, state = case.drop, film(case)
    size = np.pi * drop.diameter_m

    def thickening(blowing: Floats) -> Floats:
        return np.asarray(np.exp(0.7 * blowing) * _blown(blowing))

    def still(number: Floats) -> Floats:
        rise = np.clip(state.reynolds, 1, 400) ** 0.077
        return np.asarray(np.cbrt(1 + state.reynolds * number) * rise - 1)

    blowing = np.log1p(state.transfer)
    sherwood = 2 + still(state.schmidt) / thickening(blowing)
    mass = size * state.diffusion_kg_m_s * sherwood * blowing
    bare = mass * state.cp_vapour_J_kg_K / (size * state.conductivity_W_m_K)
    low, high = np.full_like(mass, -100.0), np.full_like(mass, 100.0)
    for _ in range(80):  # of ln(1 + BT)
        middle = 0.5 * (low + high)
        nusselt = 2 + still(state.prandtl) / thickening(middle)
        below = middle * nusselt < bare
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return mass, _heat(case, state, mass, nusselt)


def dukowicz(case: Case) -> Pair:
    drop, known, state = case.drop, case.known, film(case, 0.5)
    nusselt = 2 + 0.6 * np.sqrt(state.reynolds) * np.cbrt(state.prandtl)
    bare = np.pi * drop.diameter_m * state.conductivity_W_m_K * nusselt
    middle = 0.5 * (drop.temperature_K + drop.gas_temperature_K)
    cp = drop.vapour * known.gas(0, middle)[0] + (1 - drop.vapour) * known.gas(1, middle)[0]
    mass = bare / cp * state.transfer
    heat = bare * (drop.gas_temperature_K - drop.temperature_K)
    return mass, heat - mass * known.liquid(drop.temperature_K)[3]


def dukowicz_logarithmic(case: Case) -> Pair:
    mass, heat = dukowicz(case)
    weaker = _blown(np.log1p(film(case).transfer))
    return mass * weaker, heat * weaker


def frolov_type(case: Case) -> Pair:
    drop, conductivity = case.drop, case.known.liquid(case.drop.temperature_K)[4]
    conductance = 10 * np.pi * drop.diameter_m * conductivity
    low = np.full_like(drop.temperature_K, case.fuel.liquid.low_K)
    high = np.full_like(low, case.fuel.liquid.high_K)
    for _ in range(60):
        surface = 0.5 * (low + high)
        heat = spalding(replace(case, drop=replace(drop, temperature_K=surface)))[1]
        below = surface - drop.temperature_K < heat / conductance
        low, high = np.where(below, surface, low), np.where(below, high, surface)
    return spalding(replace(case, drop=replace(drop, temperature_K=low)))


RATES: dict[str, Callable[[Case], Pair]] = {
    "abramzon-sirignano": abramzon_sirignano,
    "spalding": spalding,
    "dukowicz": dukowicz,
    "dukowicz-log": dukowicz_logarithmic,
    "frolov-type": frolov_type,
}


def _heat(case: Case, state: Film, mass: Floats, nusselt: Floats) -> Floats:
    drop = case.drop
    bare = np.pi * drop.diameter_m * state.conductivity_W_m_K * nusselt
    blown = _blown(mass * state.cp_vapour_J_kg_K / bare)
    latent = case.known.liquid(drop.temperature_K)[3]
    return np.asarray(bare * (drop.gas_temperature_K - drop.temperature_K) * blown - mass * latent)


def _blown(x: Floats) -> Floats:
    safe = np.where(np.abs(x) < 1e-12, 1e-12, x)
    return np.asarray(safe / np.expm1(safe))
