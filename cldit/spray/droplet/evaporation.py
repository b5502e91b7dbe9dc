"""Evaporation of the droplets of a cone, compiled with numba: mass loss, and heat into the liquid.

Other droplets are those of kernels/spray/evaporation.h. A model is a compiled function of one
droplet (`gasfilm.Here`) that returns kg/s and W. Both are driven by the mass transfer number, so
that fuel also evaporates in a colder gas, and are bounded at boiling.
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
    HERE,
    LATENT,
    TABLES,
    FilmState,
    Here,
    Tables,
    film_state,
    liquid_at,
    tables,
)
from cldit.spray.droplet.rates import Rates
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
class Model:
    """Compiled rule for one droplet, callable for many."""

    rule: Rule

    def __call__(self, drop: Drop) -> Rates:
        found = np.empty((len(drop.diameter_m), 2))
        _machine()(self.rule, tables(drop.fuel, drop.gas), drop.columns, found)
        return Rates(found[:, 0], found[:, 1])


@compiled
def _here(row: Floats) -> Here:
    return Here(row[0], row[1], row[2], row[3], row[4], row[5])


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


abramzon_sirignano = Model(abramzon_sirignano_rule)
spalding = Model(spalding_rule)
