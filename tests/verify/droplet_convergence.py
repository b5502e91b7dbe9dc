"""Error of the integrator against an independent solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cldit.arrays import Floats
from cldit.spray.droplet.advance import DropletStates, DropletSurroundings, advance
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.droplet.rates import Drop, rates

_COPIES = 64  # of the droplet, followed together as in a spray
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
