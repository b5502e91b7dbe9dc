"""Integration of many droplets in a gas that is constant during a step, on an OpenCL device.

kernels/spray/droplet_step.h integrates eight droplets, or one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import Fuel, HIGHEST_Pa

GAS_TOLERANCE = 1e-2  # of a droplet's step in a computed gas, which is not more accurate


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
    kernels: DropletKernels,
    *,
    tolerance: float = 1e-3,
    drag: bool = True,
) -> Advance:
    """Integrates N droplets over any duration, with steps of their own.

    Args:
        droplets, surroundings: (N,) initial droplets, and gas around each; up to three axes.
        duration_s: of the integration.
        kernels: fuel, carrier gas, evaporation model and device.
        tolerance: allowed error of a step, relative to s and to 100 K; inf: one step.
        drag: without it velocities are constant (a droplet on a fibre).

    Raises:
        SprayError: impossible droplets or surroundings; a droplet cannot be integrated.
    """
    fuel = kernels.fuel
    check_states(droplets, surroundings, duration_s, fuel)
    gas = surroundings
    axes = droplets.velocity_m_s.shape[1]
    rest = [np.zeros(len(droplets.mass_kg))] * (3 - axes)  # kernels have three axes
    out, final = kernels.run(
        "advance_droplets",
        {
            "gas": [gas.temperature_K, gas.pressure_Pa, gas.vapour, *gas.velocity_m_s.T, *rest],
            "droplets": [droplets.mass_kg, droplets.temperature_K, *droplets.velocity_m_s.T, *rest],
        },
        5,
        duration=float(duration_s),
        tolerance=min(float(tolerance), float(np.finfo(kernels.real).max)),
        drag=int(drag),
    )
    mass, temperature, *velocity = final["droplets"]
    *path, elapsed, rounds = out
    if np.any(rounds < 0):
        stuck = int(np.argmax(rounds < 0))
        raise SprayError(stuck_text(fuel, mass, temperature, gas, stuck))
    speed = np.stack(velocity[:axes], axis=1)
    heat = fuel.liquid.value("enthalpy", temperature)
    heat0 = fuel.liquid.value("enthalpy", droplets.temperature_K)
    return Advance(
        droplets=DropletStates(mass, temperature, speed),
        gone_s=np.where(mass > 0, np.inf, elapsed),
        path_m=np.stack(path[:axes], axis=1),
        mass_kg=droplets.mass_kg - mass,
        enthalpy_J=droplets.mass_kg * heat0 - mass * heat,
        momentum_kg_m_s=droplets.mass_kg[:, None] * droplets.velocity_m_s - mass[:, None] * speed,
        steps=int(rounds.max(initial=0)),
    )


def follow_droplets(
    droplets: DropletStates,
    surroundings: DropletSurroundings,
    durations_s: Floats,
    kernels: DropletKernels,
    *,
    tolerance: float,
) -> tuple[Floats, Floats]:
    """Mass and velocity (A, N) of N droplets after each of A steps; raises as `advance`.

    Args:
        droplets: (N,) initial droplets, with velocities along one axis, (N, 1).
        surroundings: (A, N) gas around each in each step, and its velocity along that axis.
        durations_s: (A,) of the steps.
    """
    steps, count = surroundings.temperature_K.shape
    check_states(droplets, surroundings, float(durations_s.max()), kernels.fuel)
    rest, duration = np.zeros((steps, count)), np.repeat(durations_s[:, None], count, axis=1)
    at = surroundings
    gas = (at.temperature_K, at.pressure_Pa, at.vapour, at.velocity_m_s)
    rows = np.stack([*gas, rest, rest, duration], axis=1)
    start = [droplets.mass_kg, droplets.temperature_K, droplets.velocity_m_s[:, 0]]
    columns = {"gas": [*rows.reshape(-1, count)], "initial": [*start, rest[0], rest[0]]}
    out, _ = kernels.run("follow_droplets", columns, 4 * steps, steps=steps, tolerance=tolerance)
    mass, temperature, velocity, rounds = out.reshape(steps, 4, count).swapaxes(0, 1)
    if np.any(rounds < 0):
        step, stuck = np.argwhere(rounds < 0)[0]
        stuck_gas = DropletSurroundings(*(values[step] for values in gas))
        raise SprayError(stuck_text(kernels.fuel, mass[step], temperature[step], stuck_gas, stuck))
    return mass, velocity


def check_states(
    droplets: DropletStates, surroundings: DropletSurroundings, duration_s: float, fuel: Fuel
) -> None:
    """Raises SprayError for impossible droplets, surroundings or durations."""
    mass, temperature = droplets.mass_kg, droplets.temperature_K
    checks = (
        ("mass_kg of a droplet", mass, 0.0, 1e-3),
        ("temperature_K of a droplet", temperature, fuel.liquid.low_K, fuel.liquid.high_K),
        ("temperature_K of the gas", surroundings.temperature_K, 80.0, fuel.vapour.high_K),
        ("pressure_Pa of the gas", surroundings.pressure_Pa, 1e3, HIGHEST_Pa),
        ("vapour, mass fraction in the gas,", surroundings.vapour, 0.0, 1.0),
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
    for name, speeds in (("droplet", droplets.velocity_m_s), ("gas", surroundings.velocity_m_s)):
        if not np.all(np.abs(speeds) < 1e4):
            raise SprayError(f"velocity_m_s of the {name} is not finite, or above 10 km/s")


def stuck_text(
    fuel: Fuel, mass: Floats, temperature: Floats, surroundings: DropletSurroundings, at: int
) -> str:
    """Message on droplet number `at`, whose steps have no end."""
    return (
        f"droplet {at} of {fuel.name} cannot be integrated: mass {mass[at]:g} kg, "
        f"{temperature[at]:g} K, in gas of {surroundings.temperature_K[at]:g} K, "
        f"{surroundings.pressure_Pa[at]:g} Pa, vapour {surroundings.vapour[at]:g}"
    )
