"""Integration of the droplets of a cone in a gas that is constant during a step, with numba.

`steps` integrates one droplet; `advance` does the same on an OpenCL device.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cldit.errors import SprayError
from cldit.spray.droplet.advance import (
    Advance,
    DropletStates,
    DropletSurroundings,
    check_states,
    stuck_text,
)
from cldit.spray.droplet.evaporation import Model
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.gasfilm import tables
from cldit.spray.droplet.steps import follower

THREADS = min(os.cpu_count() or 1, 8)
_TOGETHER = 1024  # droplets that a thread takes at a time; stiff ones occur in groups


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
    check_states(droplets, surroundings, duration_s, fuel)
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
        raise SprayError(stuck_text(fuel, mass, temperature, surroundings, stuck))
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
