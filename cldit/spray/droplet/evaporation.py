"""Evaporation models: mass loss of a droplet, and heat into its liquid.

A model is a compiled function of one droplet (`gasfilm.Here`) that returns kg/s and W; a new one is
one function and one line in `MODELS`. All are driven by the mass transfer number, so that fuel also
evaporates in a colder gas, and all are bounded at boiling.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np

from cldit.arrays import Floats
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.gasfilm import (
    CONDUCTIVITY,
    HERE,
    LATENT,
    TABLES,
    FilmState,
    Here,
    Tables,
    cp_far,
    film_state,
    liquid_at,
    surface_share,
    tables,
)
from cldit.spray.numba_typing import compiled, compiled_for

Rule = Callable[[Tables, Here], tuple[float, float]]
types: Any = numba.types  # without annotations of its own
RULE = types.FunctionType(types.UniTuple(types.float64, 2)(TABLES, HERE))


@dataclass(frozen=True)
class Drop:
    """Droplets and the gas far from each; all (N,).

    temperature_K: of the liquid, uniform. vapour: mass fraction of fuel in the gas.
    slip_m_s: speed relative to the gas.
    """

    fuel: Fuel
    gas: Gas
    diameter_m: Floats
    temperature_K: Floats
    gas_temperature_K: Floats
    pressure_Pa: Floats
    vapour: Floats
    slip_m_s: Floats

    @cached_property
    def columns(self) -> Floats:
        """Fields of `Here` of every droplet, (N, 6)."""
        return np.stack([getattr(self, name) for name in Here._fields], axis=1).astype(float)


@dataclass(frozen=True)
class Rates:
    """Rates, all (N,). mass_kg_s: evaporation, < 0 in condensation. heat_W: into the liquid."""

    mass_kg_s: Floats
    heat_W: Floats


@dataclass(frozen=True)
class Model:
    """Compiled rule for one droplet, callable for many."""

    rule: Rule

    def __call__(self, drop: Drop) -> Rates:
        found = np.empty((len(drop.diameter_m), 2))
        _machine()(self.rule, tables(drop.fuel, drop.gas), drop.columns, found)
        return Rates(found[:, 0], found[:, 1])


@dataclass(frozen=True)
class Film:
    """Gas around a droplet at its reference state; all (N,).

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
    """Mass fraction of fuel at the surface (Raoult's law, limited at boiling)."""
    found = np.empty(len(drop.diameter_m))
    _surfaces(tables(drop.fuel, drop.gas), drop.columns, found)
    return found


def film(drop: Drop, *, share: float = 1 / 3) -> Film:
    """Film at a `share` of the way from the surface to the gas, see `gasfilm.film_state`."""
    found = np.empty((len(FilmState._fields), len(drop.diameter_m)))
    _films(tables(drop.fuel, drop.gas), drop.columns, share, found)
    return Film(*found)


@compiled
def _here(row: Floats) -> Here:
    return Here(row[0], row[1], row[2], row[3], row[4], row[5])


@compiled
def _surfaces(tables: Tables, rows: Floats, result: Floats) -> None:
    for n in range(len(rows)):
        result[n] = surface_share(tables, _here(rows[n]))


@compiled
def _films(tables: Tables, rows: Floats, share: float, result: Floats) -> None:
    for n in range(len(rows)):
        state = film_state(tables, _here(rows[n]), share)
        for place, value in enumerate(state):
            result[place, n] = value


def _every(rule: Rule, tables: Tables, rows: Floats, result: Floats) -> None:
    for n in range(len(rows)):
        mass, heat = rule(tables, _here(rows[n]))
        result[n, 0] = mass
        result[n, 1] = heat


@functools.cache
def _machine() -> Callable[..., None]:
    rows = types.float64[:, ::1]
    return compiled_for(_every, (RULE, TABLES, rows, rows))


@compiled
def spalding_of(here: Here, state: FilmState, latent: float) -> tuple[float, float]:
    """Evaporation [kg/s] and heat [W] by film theory (Spalding 1953), for a given film."""
    sherwood = _ranz_marshall(state.reynolds, state.schmidt)
    mass = np.pi * here.diameter_m * state.diffusion_kg_m_s * sherwood * np.log1p(state.transfer)
    return _with_heat(here, state, latent, mass, _ranz_marshall(state.reynolds, state.prandtl))


@compiled
def spalding_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Film theory (Spalding 1953), Ranz-Marshall, heat flux with blowing; film at one third."""
    latent = liquid_at(tables, LATENT, here.temperature_K)
    return spalding_of(here, film_state(tables, here, 1 / 3), latent)


@compiled
def abramzon_sirignano_of(here: Here, state: FilmState, latent: float) -> tuple[float, float]:
    """Evaporation [kg/s] and heat [W] by film theory with blowing, for a given film."""
    blowing = np.log1p(state.transfer)
    sherwood = 2 + (_clift(state.reynolds, state.schmidt) - 2) / _thickening(blowing)
    mass = np.pi * here.diameter_m * state.diffusion_kg_m_s * sherwood * blowing
    nusselt = 2.0
    still = _clift(state.reynolds, state.prandtl) - 2
    if still > 0:
        # ln(1 + BT) = mass cp_v / (pi d lam Nu*), and Nu* = 2 + (Nu0 - 2)/F(BT): a contraction,
        # since F hardly changes with BT.
        bare = mass * state.cp_vapour_J_kg_K / (np.pi * here.diameter_m * state.conductivity_W_m_K)
        nusselt = 2 + still / _thickening(bare / (2 + still))
        for _ in range(40):
            before = nusselt
            nusselt = 2 + still / _thickening(bare / nusselt)
            if np.abs(nusselt - before) <= 1e-9 * nusselt:
                break
    return _with_heat(here, state, latent, mass, nusselt)


@compiled
def abramzon_sirignano_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Abramzon and Sirignano (1989): film theory with films that thicken by blowing.

    Int. J. Heat Mass Transfer 32, 1605; Clift's correlation for the droplet without blowing.
    """
    latent = liquid_at(tables, LATENT, here.temperature_K)
    return abramzon_sirignano_of(here, film_state(tables, here, 1 / 3), latent)


@compiled
def _dukowicz(tables: Tables, here: Here) -> tuple[float, float, float]:
    """Evaporation and heat without the logarithm, and the transfer number."""
    state = film_state(tables, here, 0.5)
    nusselt = _ranz_marshall(state.reynolds, state.prandtl)
    middle = 0.5 * (here.temperature_K + here.gas_temperature_K)
    bare = np.pi * here.diameter_m * state.conductivity_W_m_K * nusselt
    mass = bare / cp_far(tables, here, middle) * state.transfer
    convection = bare * (here.gas_temperature_K - here.temperature_K)
    latent = liquid_at(tables, LATENT, here.temperature_K)
    return mass, convection - mass * latent, state.transfer


@compiled
def dukowicz_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Dukowicz, LA-7997-MS (1979), Le = 1, without 0/0 at equal temperatures.

    The rate is pi d Nu (lam/cp_gas) BM, linear in BM, with the film half way.
    """
    mass, heat, _ = _dukowicz(tables, here)
    return mass, heat


@compiled
def dukowicz_logarithmic_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Model `dukowicz` with the factor ln(1 + B)/B on both fluxes, as in several codes."""
    mass, heat, number = _dukowicz(tables, here)
    safe = 1e-12 if np.abs(number) < 1e-12 else number
    weaker = np.log1p(safe) / safe
    return mass * weaker, heat * weaker


@compiled
def _with_surface(tables: Tables, here: Here, surface_K: float) -> tuple[float, float]:
    changed = Here(
        here.diameter_m,
        surface_K,
        here.gas_temperature_K,
        here.pressure_Pa,
        here.vapour,
        here.slip_m_s,
    )
    return spalding_rule(tables, changed)


@compiled
def frolov_type_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Film theory outside, finite conductivity inside.

    The temperature profile is parabolic, so that the surface is at T + heat / (10 pi k d). The
    model is similar to that of Frolov, Frolov and Basara (2006), whose formulation was not
    available.
    """
    inside = here.temperature_K
    conductance = 10 * np.pi * here.diameter_m * liquid_at(tables, CONDUCTIVITY, inside)
    # The residual rises with the surface temperature: secant method within a bracket.
    low, high = tables.liquid_low_K, tables.liquid_high_K
    mass, heat = _with_surface(tables, here, inside)
    before, value_before = inside, -heat / conductance
    at = min(max(before - 0.5 * value_before, low), high)
    for _ in range(60):
        mass, heat = _with_surface(tables, here, at)
        value = at - inside - heat / conductance
        if value < 0:
            low = at
        else:
            high = at
        change = value - value_before
        slope = 1.0
        if at != before:
            slope = (1.0 if change == 0 else change) / (at - before)
        move = value / slope if slope > 1e-3 else value
        if np.abs(move) <= 1e-9 or high - low <= 1e-9:
            break
        target = at - move
        before, value_before = at, value
        at = target if low < target < high else 0.5 * (low + high)
    return mass, heat


@compiled
def _with_heat(
    here: Here, state: FilmState, latent: float, mass: float, nusselt: float
) -> tuple[float, float]:
    """Adds the heat: convection reduced by blowing, b/(exp b - 1), less the latent heat."""
    bare = np.pi * here.diameter_m * state.conductivity_W_m_K * nusselt
    b = mass * state.cp_vapour_J_kg_K / bare
    safe = 1e-12 if np.abs(b) < 1e-12 else b
    heat = bare * (here.gas_temperature_K - here.temperature_K) * safe / np.expm1(safe)
    return mass, heat - mass * latent


@compiled
def _ranz_marshall(reynolds: float, number: float) -> float:
    return float(2 + 0.6 * np.sqrt(reynolds) * np.cbrt(number))


@compiled
def _clift(reynolds: float, number: float) -> float:
    rise = min(max(reynolds, 1.0), 400.0) ** 0.077
    return float(1 + np.cbrt(1 + reynolds * number) * rise)


@compiled
def _thickening(blowing: float) -> float:
    """Thickening F(B) = (1 + B)^0.7 ln(1 + B)/B as a function of ln(1 + B)."""
    safe = 1e-12 if np.abs(blowing) < 1e-12 else blowing
    return float(np.exp(0.7 * safe) * safe / np.expm1(safe))


@compiled
def inert_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Rule of a droplet that neither evaporates nor warms."""
    return 0.0, 0.0


abramzon_sirignano = Model(abramzon_sirignano_rule)
spalding = Model(spalding_rule)
dukowicz = Model(dukowicz_rule)
frolov_type = Model(frolov_type_rule)
inert = Model(inert_rule)

MODELS: dict[str, Model] = {
    "abramzon-sirignano": abramzon_sirignano,
    "spalding": spalding,
    "dukowicz": dukowicz,
    "dukowicz-log": Model(dukowicz_logarithmic_rule),
    "frolov-type": frolov_type,
}
