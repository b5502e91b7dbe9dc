"""Error of the integrator against step size and run time, beside an independent solver."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.spray.droplet.advance import DropletStates, DropletSurroundings, advance
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import Fuel, fuel_table, gas_table
from cldit.spray.droplet.models import MODELS
from cldit.spray.droplet.rates import Drop, rates

_COPIES = 64  # of the droplet, followed together as in a spray
_STEPS = (1, 2, 4, 8, 16, 32, 64, 128)
_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
_EULER_STEPS = (16, 32, 64, 128, 256, 512, 1024)
_CUT = 1e-4  # of s, where the reference hands over to s falling evenly


@dataclass(frozen=True)
class Case:
    """A droplet of n-heptane at rest in nitrogen."""

    name: str
    diameter_m: float
    temperature_K: float
    gas_K: float
    pressure_Pa: float


CASES = (
    Case("9 µm, 370 K in 573 K, 0.6 MPa", 9e-6, 370.0, 573.0, 0.6e6),
    Case("stiff: 9 µm, 370 K in 620 K, 0.15 MPa", 9e-6, 370.0, 620.0, 0.15e6),
    Case("d → 0: 0.3 µm, 370 K in 620 K, 0.15 MPa", 0.3e-6, 370.0, 620.0, 0.15e6),
    Case("0.1 K below boiling: 9 µm in 1100 K, 0.15 MPa", 9e-6, 385.4, 1100.0, 0.15e6),
)


@dataclass(frozen=True)
class Convergence:
    """Errors with fixed steps, and with steps chosen for falling tolerances, (N,) each.

    Errors are those of `error_of`, seconds are processor time per droplet.
    """

    case: Case
    model: str
    step_s: Floats
    step_error: Floats
    adaptive_error: Floats
    adaptive_seconds: Floats


@dataclass(frozen=True)
class Reference:
    """Lifetime, and what is left of the mass after half of it."""

    life_s: float
    left: float


def reference(case: Case, kernels: DropletKernels) -> Reference:
    """Solves with scipy's Radau, in s = (m/m0)^(2/3) and T, with the plain rates of the model."""
    fuel = kernels.fuel
    first = float(fuel.mass_kg(case.diameter_m, case.temperature_K))

    def slopes(_: float, y: Floats) -> tuple[float, float]:
        s = max(float(y[0]), _CUT)
        mass = first * s**1.5
        rate, heat = _rates(case, kernels, mass, float(y[1]))
        cp = float(fuel.liquid.value("cp", y[1]))
        return -2 / 3 * s * rate / mass, heat / (mass * cp)

    def cut(_: float, y: Floats) -> float:
        return float(y[0]) - _CUT

    cut.terminal = True  # type: ignore[attr-defined]
    found: Any = solve_ivp(
        slopes,
        (0.0, 10.0),
        (1.0, case.temperature_K),
        method="Radau",
        rtol=1e-7,
        atol=(1e-8, 1e-5),
        first_step=case.diameter_m**2 * 1e-3,
        events=cut,
        dense_output=True,
    )
    end, state = float(found.t[-1]), found.y[:, -1]
    life = end + _CUT / -slopes(end, state)[0]
    return Reference(life, float(found.sol(life / 2)[0]) ** 1.5)


def error_of(found: Reference, wanted: Reference) -> float:
    """The larger of two errors of `found` against `wanted`.

    That of the lifetime is relative; that of the mass at half of it is a share of the first mass.
    """
    return max(abs(found.life_s / wanted.life_s - 1), abs(found.left - wanted.left))


def integrated(
    case: Case,
    kernels: DropletKernels,
    *,
    half_s: float,
    steps: int,
    tolerance: float,
) -> Reference:
    """Solves with the library's own integrator, in calls of equal length."""
    start, around = _states(case, kernels.fuel)
    step = half_s / steps
    state, at, left = start, 0.0, 0.0
    for number in range(100 * steps + 100):
        found = advance(state, around, step, kernels, tolerance=tolerance)
        state = found.droplets
        if number == steps - 1:
            left = float(state.mass_kg[0] / start.mass_kg[0])
        if np.isfinite(found.gone_s[0]):
            return Reference(at + float(found.gone_s[0]), left)
        at += step
    return Reference(np.inf, left)


def explicit_euler(case: Case, kernels: DropletKernels, *, half_s: float, steps: int) -> Reference:
    """Plain steps of mass and temperature, for comparison; infinite where it breaks down."""
    fuel = kernels.fuel
    first = mass = float(fuel.mass_kg(case.diameter_m, case.temperature_K))
    warm, step, left = case.temperature_K, half_s / steps, 0.0
    for number in range(10 * steps):
        rate, heat = _rates(case, kernels, mass, warm)
        if mass <= rate * step:
            return Reference(number * step + mass / rate, left)
        warm += step * heat / (mass * float(fuel.liquid.value("cp", warm)))
        mass -= rate * step
        if not fuel.liquid.low_K < warm < fuel.liquid.high_K:
            break
        if number == steps - 1:
            left = mass / first
    return Reference(np.inf, left)


def measure(case: Case, model: str, kernels: DropletKernels) -> Convergence:
    """Errors and run times of one model in one case."""
    wanted = reference(case, kernels)
    rows: list[tuple[float, float]] = []
    for steps, tolerance in [(n, np.inf) for n in _STEPS] + [(1, tol) for tol in _TOLERANCES]:
        began = time.process_time()
        found = integrated(
            case,
            kernels,
            half_s=wanted.life_s / 2,
            steps=steps,
            tolerance=tolerance,
        )
        rows.append((error_of(found, wanted), (time.process_time() - began) / _COPIES))
    error, seconds = np.array(rows).T
    fixed = len(_STEPS)
    return Convergence(
        case=case,
        model=model,
        step_s=wanted.life_s / 2 / np.array(_STEPS),
        step_error=error[:fixed],
        adaptive_error=error[fixed:],
        adaptive_seconds=seconds[fixed:],
    )


def measure_euler(case: Case, kernels: DropletKernels) -> tuple[Floats, Floats]:
    """Errors of `explicit_euler`."""
    wanted = reference(case, kernels)
    half = wanted.life_s / 2
    error = [
        error_of(explicit_euler(case, kernels, half_s=half, steps=n), wanted) for n in _EULER_STEPS
    ]
    return half / np.array(_EULER_STEPS), np.array(error)


def measure_all(
    cache: Path,
    device: Device,
) -> tuple[list[Convergence], dict[Case, tuple[Floats, Floats]]]:
    """All models in all cases; and explicit Euler with the first model."""
    fuel, gas = fuel_table("n-heptane", cache=cache), gas_table("nitrogen", cache=cache)
    kernels = {name: DropletKernels.of(device, fuel, gas, model) for name, model in MODELS.items()}
    found = [measure(case, name, kernels[name]) for case in CASES for name in MODELS]
    first = kernels[next(iter(MODELS))]
    return found, {case: measure_euler(case, first) for case in CASES}


def _states(case: Case, fuel: Fuel) -> tuple[DropletStates, DropletSurroundings]:
    def many(value: float) -> Floats:
        return np.full(_COPIES, value)

    mass = fuel.mass_kg(many(case.diameter_m), many(case.temperature_K))
    rest = np.zeros((_COPIES, 1))
    return (
        DropletStates(mass, many(case.temperature_K), rest),
        DropletSurroundings(many(case.gas_K), many(case.pressure_Pa), many(0.0), rest),
    )


def _rates(
    case: Case,
    kernels: DropletKernels,
    mass: float,
    temperature: float,
) -> tuple[float, float]:
    found = rates(
        Drop(
            diameter_m=kernels.fuel.diameter_m([mass], [temperature]),
            temperature_K=np.array([temperature]),
            gas_temperature_K=np.array([case.gas_K]),
            pressure_Pa=np.array([case.pressure_Pa]),
            vapour=np.zeros(1),
            slip_m_s=np.zeros(1),
        ),
        kernels,
    )
    return float(found.mass_kg_s[0]), float(found.heat_W[0])
