"""Integration of many droplets in a gas that is constant during a step, on all processors.

`steps` integrates one droplet.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.spray.droplet.evaporation import Model
from cldit.spray.droplet.fluids import Fuel, Gas, HIGHEST_Pa
from cldit.spray.droplet.gasfilm import tables
from cldit.spray.droplet.steps import follower

THREADS = min(os.cpu_count() or 1, 8)
_TOGETHER = 1024  # droplets that a thread takes at a time; stiff ones occur in groups


@dataclass(frozen=True)
class DropletStates:
    """Droplets: mass_kg of each and temperature_K, (N,); velocity_m_s, (N, k), any k."""

    mass_kg: Floats
    temperature_K: Floats
    velocity_m_s: Floats


@dataclass(frozen=True)
class DropletSurroundings:
    """Gas around each droplet, (N,); velocity_m_s, (N, k). vapour: mass fraction of fuel."""

    temperature_K: Floats
    pressure_Pa: Floats
    vapour: Floats
    velocity_m_s: Floats


@dataclass(frozen=True)
class Advance:
    """Droplets after a step, and their losses to the gas.

    droplets: those that vanished have mass 0, the velocity of the gas and their last temperature.
    gone_s: time at which each vanished; inf for the others.
    path_m: displacement of each, (N, k), until it vanished.
    mass_kg, enthalpy_J (N,), momentum_kg_m_s (N, k): lost by the liquid, so that the sum of gas and
        liquid is conserved. Enthalpies are on the zero of `fuel.liquid`.
    steps: largest number of steps of a droplet, including rejected ones.
    """

    droplets: DropletStates
    gone_s: Floats
    path_m: Floats
    mass_kg: Floats
    enthalpy_J: Floats
    momentum_kg_m_s: Floats
    steps: int


def advance(
    droplets: DropletStates,
    surroundings: DropletSurroundings,
    duration_s: float,
    *,
    fuel: Fuel,
    gas: Gas,
    model: Model,
    tolerance: float = 1e-3,
    drag: bool = True,
) -> Advance:
    """Integrates N droplets over any duration, with steps of their own.

    Args:
        droplets, surroundings: (N,) initial droplets, and gas around each.
        duration_s: of the integration.
        fuel, gas: property tables.
        model: of evaporation.
        tolerance: allowed error of a step, relative to s and to 100 K; inf: one step.
        drag: without it velocities are constant (a droplet on a fibre).

    Raises:
        SprayError: impossible droplets or surroundings; a droplet cannot be integrated.
    """
    _check(droplets, surroundings, duration_s, fuel)
    mass = droplets.mass_kg.astype(float)
    temperature = droplets.temperature_K.astype(float)
    velocity = droplets.velocity_m_s.astype(float, order="C")
    gone, path = np.full(mass.size, np.inf), np.zeros_like(velocity)
    rounds = np.zeros(mass.size, dtype=np.int64)
    around = [
        np.ascontiguousarray(column, dtype=float)
        for column in (
            surroundings.temperature_K,
            surroundings.pressure_Pa,
            surroundings.vapour,
            surroundings.velocity_m_s,
        )
    ]
    known, follow = tables(fuel, gas), follower()

    def some(first: int) -> None:
        part = slice(first, first + _TOGETHER)
        follow(
            model.rule,
            known,
            duration_s,
            tolerance,
            drag,
            *(column[part] for column in around),
            *(column[part] for column in (mass, temperature, velocity, gone, path, rounds)),
        )

    starts = range(0, mass.size, _TOGETHER)
    if len(starts) > 1 and THREADS > 1:
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(some, starts))
    else:
        for first in starts:
            some(first)
    if np.any(rounds < 0):
        stuck = int(np.argmax(rounds < 0))
        raise SprayError(_stuck(fuel, mass, temperature, surroundings, stuck))
    heat = fuel.liquid.one("enthalpy", temperature)
    heat0 = fuel.liquid.one("enthalpy", droplets.temperature_K)
    return Advance(
        droplets=DropletStates(mass, temperature, velocity),
        gone_s=gone,
        path_m=path,
        mass_kg=droplets.mass_kg - mass,
        enthalpy_J=droplets.mass_kg * heat0 - mass * heat,
        momentum_kg_m_s=droplets.mass_kg[:, None] * droplets.velocity_m_s
        - mass[:, None] * velocity,
        steps=int(rounds.max(initial=0)),
    )


def _check(
    droplets: DropletStates, around: DropletSurroundings, duration_s: float, fuel: Fuel
) -> None:
    mass, temperature = droplets.mass_kg, droplets.temperature_K
    checks = (
        ("mass_kg of a droplet", mass, 0.0, 1e-3),
        ("temperature_K of a droplet", temperature, fuel.liquid.low_K, fuel.liquid.high_K),
        ("temperature_K of the gas", around.temperature_K, 80.0, fuel.vapour.high_K),
        ("pressure_Pa of the gas", around.pressure_Pa, 1e3, HIGHEST_Pa),
        ("vapour, mass fraction in the gas,", around.vapour, 0.0, 1.0),
        ("duration_s", np.asarray([duration_s]), 0.0, 1e9),
    )
    for name, values, low, high in checks:
        bad = ~((values >= low) & (values <= high))
        if np.any(bad):
            value = values[bad][0]
            raise SprayError(
                f"{fuel.name}: {name} is {value:g} ({bad.sum()} such values); allowed: {low:g} "
                f"to {high:g}"
            )
    for name, speeds in (("droplet", droplets.velocity_m_s), ("gas", around.velocity_m_s)):
        if not np.all(np.abs(speeds) < 1e4):
            raise SprayError(f"velocity_m_s of the {name} is not finite, or above 10 km/s")


def _stuck(
    fuel: Fuel, mass: Floats, temperature: Floats, around: DropletSurroundings, at: int
) -> str:
    return (
        f"droplet {at} of {fuel.name} cannot be integrated: mass {mass[at]:g} kg, "
        f"{temperature[at]:g} K, in gas of {around.temperature_K[at]:g} K, "
        f"{around.pressure_Pa[at]:g} Pa, vapour {around.vapour[at]:g}"
    )
