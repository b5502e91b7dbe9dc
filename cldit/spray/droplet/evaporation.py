"""Evaporation models: how fast a droplet loses mass, and how much heat enters its liquid.

A model is a compiled function of one droplet (`gasfilm.Here`) that returns kg/s and W; another one
is one function and one line in `MODELS`. All are driven by the mass transfer number, so that a gas
colder than the fuel still evaporates it, and all are bounded at boiling.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np

from cldit.spray.droplet.curves import Floats
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.gasfilm import (
    CONDUCTIVITY,
    HERE,
    LATENT,
    TABLES,
    Here,
    State,
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

    @cached_property
    def columns(self) -> Floats:
        """What `Here` has of every droplet, (N, 6)."""
        return np.stack([getattr(self, name) for name in Here._fields], axis=1).astype(float)


@dataclass(frozen=True)
class Rates:
    """All (N,). mass_kg_s: evaporating, negative when vapour condenses. heat_W: into the liquid."""

    mass_kg_s: Floats
    heat_W: Floats


@dataclass(frozen=True)
class Model:
    """A compiled rule for one droplet, callable for many."""

    rule: Rule

    def __call__(self, drop: Drop) -> Rates:
        found = np.empty((len(drop.diameter_m), 2))
        _machine()(self.rule, tables(drop.fuel, drop.gas), drop.columns, found)
        return Rates(found[:, 0], found[:, 1])


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
    found = np.empty(len(drop.diameter_m))
    _surfaces(tables(drop.fuel, drop.gas), drop.columns, found)
    return found


def film(drop: Drop, *, share: float = 1 / 3) -> Film:
    """Film of `drop` at `share` of the way to the gas; see `gasfilm.film_state`."""
    found = np.empty((len(State._fields), len(drop.diameter_m)))
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
def spalding_of(here: Here, state: State, latent: float) -> tuple[float, float]:
    """Film theory (Spalding 1953) on a given film.

    Args:
        here: the droplet.
        state: its film.
        latent: latent heat [J/kg].

    Returns:
        Evaporation [kg/s], and heat into the liquid [W].
    """
    sherwood = _ranz_marshall(state.reynolds, state.schmidt)
    mass = np.pi * here.diameter_m * state.diffusion_kg_m_s * sherwood * np.log1p(state.transfer)
    return _with_heat(here, state, latent, mass, _ranz_marshall(state.reynolds, state.prandtl))


@compiled
def spalding_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Film theory (Spalding 1953), Ranz-Marshall, heat flux with blowing; film at one third.

    Of `tables` and the droplet `here`: kg/s and W.
    """
    latent = liquid_at(tables, LATENT, here.temperature_K)
    return spalding_of(here, film_state(tables, here, 1 / 3), latent)


@compiled
def abramzon_sirignano_of(here: Here, state: State, latent: float) -> tuple[float, float]:
    """Film theory whose films thicken with blowing, on a given film.

    Args:
        here: the droplet.
        state: its film.
        latent: latent heat [J/kg].

    Returns:
        Evaporation [kg/s], and heat into the liquid [W].
    """
    blowing = np.log1p(state.transfer)
    sherwood = 2 + (_clift(state.reynolds, state.schmidt) - 2) / _thickening(blowing)
    mass = np.pi * here.diameter_m * state.diffusion_kg_m_s * sherwood * blowing
    nusselt = 2.0
    still = _clift(state.reynolds, state.prandtl) - 2
    if still > 0:
        # ln(1 + BT) = mass cp_v / (pi d lam Nu*), and Nu* = 2 + (Nu0 - 2)/F(BT): a contraction,
        # for F hardly changes with BT.
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
    """Abramzon and Sirignano (1989): film theory whose films thicken with blowing.

    Int. J. Heat Mass Transfer 32, 1605; Clift's correlation for the droplet without blowing. Of
    `tables` and the droplet `here`: kg/s and W.
    """
    latent = liquid_at(tables, LATENT, here.temperature_K)
    return abramzon_sirignano_of(here, film_state(tables, here, 1 / 3), latent)


@compiled
def _dukowicz(tables: Tables, here: Here) -> tuple[float, float, float]:
    """Both rates without the logarithm, and the transfer number."""
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

    pi d Nu (lam/cp_gas) BM: linear in BM; film half way. Of `tables` and the droplet `here`: kg/s
    and W.
    """
    mass, heat, _ = _dukowicz(tables, here)
    return mass, heat


@compiled
def dukowicz_logarithmic_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """`dukowicz` with ln(1 + B)/B on both fluxes, as several codes have it.

    Of `tables` and the droplet `here`: kg/s and W.
    """
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

    A parabolic profile of temperature, so that the surface is at T + heat / (10 pi k d). In the
    manner of Frolov, Frolov and Basara (2006), whose own formulation was not at hand.

    Of `tables` and the droplet `here`: kg/s and W.
    """
    inside = here.temperature_K
    conductance = 10 * np.pi * here.diameter_m * liquid_at(tables, CONDUCTIVITY, inside)
    # The residual rises with the surface temperature: secants, kept inside a bracket.
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
    here: Here, state: State, latent: float, mass: float, nusselt: float
) -> tuple[float, float]:
    """Convection weakened by the blowing vapour, b/(exp b - 1), less the latent heat."""
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
    """F(B) = (1 + B)^0.7 ln(1 + B)/B as a function of ln(1 + B)."""
    safe = 1e-12 if np.abs(blowing) < 1e-12 else blowing
    return float(np.exp(0.7 * safe) * safe / np.expm1(safe))


@compiled
def inert_rule(tables: Tables, here: Here) -> tuple[float, float]:
    """Neither evaporates nor warms, whatever `tables` and the droplet `here` are."""
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
