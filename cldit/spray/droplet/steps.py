"""Steps of one droplet, compiled.

In theta, with d(theta) = dt / s and s = (m / m0)^(2/3), the rates of a shrinking droplet do not
diverge: s decreases linearly in t, and temperature and slip relax exponentially in theta, which is
infinite when the droplet vanishes. A step integrates that exactly (so the droplet may vanish, at a
known time) and corrects for the change of the rates during the step; the correction is the
estimated error, which determines the steps of each droplet.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import types

from cldit.arrays import Floats, Ints
from cldit.spray.droplet.evaporation import RULE, Rule
from cldit.spray.droplet.gasfilm import (
    CP,
    DENSITY,
    TABLES,
    Here,
    Tables,
    diameter_m,
    film_state,
    liquid_at,
)
from cldit.spray.numba_typing import compiled, compiled_for

_PROBE_K = 0.01
_TEMPERATURE_SCALE_K = 100.0  # an error of 1 % of this counts as much as one of 1 % in s
_NOTHING = 1e-6  # s of a vanished droplet: 1e-9 of the mass
_MOST_ROUNDS = 3000
_CD = 0.44 / 24  # times Re: factor on Stokes drag beyond Re = 1000


@functools.cache
def follower() -> Callable[..., None]:
    """Compiled `_follow`."""
    one, two, whole = types.float64[::1], types.float64[:, ::1], types.int64[::1]
    given = (types.float64, types.float64, types.boolean, one, one, one, two)
    return compiled_for(_follow, (RULE, TABLES, *given, one, one, two, one, two, whole))


def _follow(
    rule: Rule,
    tables: Tables,
    duration_s: float,
    tolerance: float,
    drag: bool,
    gas_K: Floats,
    pressure_Pa: Floats,
    vapour: Floats,
    gas_m_s: Floats,
    mass_kg: Floats,
    temperature_K: Floats,
    velocity_m_s: Floats,
    gone_s: Floats,
    path_m: Floats,
    rounds: Ints,
) -> None:
    """Integrates each droplet over the duration; arrays from `mass_kg` on are changed in place.

    Arrays are (N,), velocities and path (N, k). rounds: number of steps; -1: no end was reached.
    """
    axes = velocity_m_s.shape[1]
    slip = np.empty(axes)
    for n in range(len(mass_kg)):
        if mass_kg[n] <= 0:
            gone_s[n] = 0.0
            continue
        elapsed, trial = 0.0, duration_s
        while duration_s > 0:
            rounds[n] += 1
            if rounds[n] > _MOST_ROUNDS:
                rounds[n] = -1
                break
            square = 0.0
            for a in range(axes):
                slip[a] = velocity_m_s[n, a] - gas_m_s[n, a]
                square += slip[a] ** 2
            asked = min(trial, duration_s - elapsed)
            speed = np.sqrt(square)
            gas = Here(0.0, 0.0, gas_K[n], pressure_Pa[n], vapour[n], speed)
            found = _step(rule, tables, gas, mass_kg[n], temperature_K[n], asked, drag)
            error = found.error / tolerance
            good = error <= 1.0
            if good:
                mass_kg[n] *= found.s**1.5
                temperature_K[n] = found.temperature_K
                for a in range(axes):
                    path_m[n, a] += gas_m_s[n, a] * found.time_s + slip[a] * found.slip_s
                    if drag:
                        velocity_m_s[n, a] = gas_m_s[n, a] + slip[a] * found.slip_ratio
                elapsed += found.time_s
                if found.s <= _NOTHING:
                    mass_kg[n] = 0.0
                    gone_s[n] = min(elapsed, duration_s)
                    break
                if elapsed >= duration_s * (1 - 1e-12):
                    break
            factor = 0.2
            if np.isfinite(error):
                factor = min(max(0.9 / np.sqrt(error), 0.2), 4.0)
            # A step limited by the end of the duration does not reduce the next one.
            cut = good and asked < trial
            trial = max(trial, factor * found.time_s) if cut else factor * found.time_s


class DropletStep(NamedTuple):
    """Result of a step.

    s: remaining share of d^2, 0 if the droplet vanished after time_s. slip_ratio: final over
    initial slip. slip_s: its integral over time. error: the largest part, infinite for an
    impossible step.
    """

    s: float
    temperature_K: float
    slip_ratio: float
    slip_s: float
    time_s: float
    error: float


@compiled
def _rates(
    rule: Rule, tables: Tables, gas: Here, mass: float, temperature: float, slip: float
) -> tuple[float, float, Here]:
    """Rates -d(ln s)/dt and dT/dt of a droplet of this mass, temperature and slip; the droplet."""
    here = Here(
        diameter_m(tables, mass, temperature),
        temperature,
        gas.gas_temperature_K,
        gas.pressure_Pa,
        gas.vapour,
        slip,
    )
    lost, heat = rule(tables, here)
    return 2 / 3 * lost / mass, heat / (mass * liquid_at(tables, CP, temperature)), here


@compiled
def _step(
    rule: Rule, tables: Tables, gas: Here, mass: float, temperature: float, time: float, drag: bool
) -> DropletStep:
    """Step of a droplet; `gas` has the surroundings and the slip, its droplet is not used."""
    slip = gas.slip_m_s
    shrink, warm, here = _rates(rule, tables, gas, mass, temperature, slip)
    shrink_probe, warm_probe, _ = _rates(rule, tables, gas, mass, temperature + _PROBE_K, slip)
    if not np.isfinite(shrink + warm + shrink_probe + warm_probe):
        return DropletStep(1.0, temperature, 1.0, 0.0, time, np.inf)
    jacobian = min((warm_probe - warm) / _PROBE_K, 0.0)
    shrink_slope = (shrink_probe - shrink) / _PROBE_K

    # Predicted: rates linear in temperature, which relaxes in theta; exact for those.
    predicted = shrink + shrink_slope * _mean_rise(warm, jacobian, shrink, time)
    if predicted > 0:
        time = min(time, 1 / predicted)
    theta = _theta(predicted, time)
    low, high = tables.liquid_low_K, tables.liquid_high_K
    change = min(max(temperature + _relaxed(warm, jacobian, theta), low), high) - temperature
    s = max(1 - predicted * time, _NOTHING)
    ratio, viscosity, density = 1.0, 1.0, 1.0
    if drag:
        state = film_state(tables, here, 1 / 3)
        viscosity, density = state.viscosity_Pa_s, state.density_kg_m3
        ratio = _slip_ratio(tables, here, density, viscosity, theta, s)

    # Corrected: the difference of the rates at the end grows linearly along the step.
    shrink_end, warm_end, end = _rates(
        rule, tables, gas, mass * s**1.5, temperature + change, slip * ratio
    )
    shift = _relaxed_ramp(s * warm_end - warm - jacobian * change, jacobian, theta)
    final = min(max(temperature + change + shift, low), high)
    more = 0.5 * (s * shrink_end - shrink - shrink_slope * change)
    shrink_mean = predicted + more
    s_end = 1 - shrink_mean * time
    error = np.abs(more) * time
    gone = s_end <= _NOTHING
    if gone:
        time = min(time, 1 / shrink_mean)
    else:
        error = max(error, np.abs(shift) / _TEMPERATURE_SCALE_K)
    if drag:
        middle = 0.5 * (viscosity + film_state(tables, end, 1 / 3).viscosity_Pa_s)
        theta = np.inf if gone else _theta(shrink_mean, time)
        better = _slip_ratio(tables, here, density, middle, theta, max(s_end, 0.0))
        error = max(error, np.abs(better - ratio) * slip / (slip + 1.0))
        ratio = better
    if not np.isfinite(more + shift + final + ratio):
        error = np.inf
    return DropletStep(0.0 if gone else s_end, final, ratio, time * _log_mean(ratio), time, error)


@compiled
def _slip_ratio(
    tables: Tables, here: Here, density: float, viscosity: float, theta: float, s: float
) -> float:
    """Ratio of the slip after theta to that before, in closed form.

    Drag is Schiller and Naumann's up to Re = 1000, then Cd = 0.44; Re is that of the mean diameter.
    """
    if np.isinf(theta):
        return 0.0
    liquid = liquid_at(tables, DENSITY, here.temperature_K)
    relaxations = theta * 18 * viscosity / (liquid * here.diameter_m**2)
    reynolds = density * here.slip_m_s * here.diameter_m / viscosity * 0.5 * (1 + np.sqrt(s))
    # Constant Cd until Re falls to 1000, then Schiller and Naumann.
    high = max(reynolds, 1e3)
    fast = min(relaxations, (high / 1e3 - 1) / (_CD * high))
    factor = 1 / (1 + _CD * reynolds * fast)
    weight = 0.15 * min(reynolds, 1e3) ** 0.687
    growth = np.exp(min(0.687 * (relaxations - fast), 600.0))
    return float(factor * ((1 + weight) * growth - weight) ** (-1 / 0.687))


@compiled
def _theta(shrink: float, time: float) -> float:
    """Integral of dt / s for s = 1 - shrink t; inf if the droplet vanishes."""
    x = min(shrink * time, 1.0)
    if np.abs(x) < 1e-8:
        return time * (1 + x / 2)
    return np.inf if x > 1 - 1e-12 else float(-np.log1p(-x) / shrink)


@compiled
def _firm(jacobian: float, theta: float) -> float:
    """Jacobian away from zero, where differences would cancel; 1e-6 of the step has no effect."""
    return min(jacobian, -1e-6 / min(theta, 1e6))


@compiled
def _relaxed(rate: float, jacobian: float, theta: float) -> float:
    """Rise over theta with the initial `rate`, relaxed by `jacobian`."""
    j = _firm(jacobian, theta)
    return float(rate * np.expm1(j * theta) / j)


@compiled
def _relaxed_ramp(rest: float, jacobian: float, theta: float) -> float:
    """Same for a rate that grows linearly from 0 to `rest`."""
    j = _firm(jacobian, theta)
    z = j * theta
    if np.abs(z) < 1e-4:  # the difference would cancel; theta is finite
        return rest * theta * (0.5 + z / 6)
    weight = 0.0 if np.isinf(z) else np.expm1(z) / z
    return float(rest * (weight - 1) / j)


@compiled
def _mean_rise(rate: float, jacobian: float, shrink: float, time: float) -> float:
    """Mean over the time (or the life, if shorter) of a rise that relaxes in theta."""
    theta = _theta(shrink, time)
    life = min(time, 1 / shrink) if shrink > 0 else time
    j = _firm(jacobian, theta)
    y = j - shrink
    if y == 0:
        y = j
    weighted = -1 / y if np.isinf(theta) else np.expm1(y * theta) / y
    return float(rate / j * (weighted / life - 1))


@compiled
def _log_mean(ratio: float) -> float:
    """Mean of an exponential that falls from 1 to `ratio`; 0 for the ratio 0."""
    if ratio > 1 - 1e-9:
        return 1.0
    return float((ratio - 1) / np.log(ratio)) if ratio > 0 else 0.0
