"""Droplets in a gas that is held fixed for the length of a step: mass, temperature, velocity.

In theta, with d(theta) = dt / s and s = (m / m0)^(2/3), the rates of a shrinking droplet no longer
diverge: s falls evenly in t, and temperature and slip relax exponentially in theta, which is
infinite where the droplet vanishes. A step follows that exactly (so it may end in nothing, at a
known time) and corrects it for how the rates changed on the way; the correction is the estimated
error, and each droplet takes as many steps of its own as that needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cldit.errors import SprayError
from cldit.spray.droplet.curves import Floats
from cldit.spray.droplet.evaporation import Drop, Model, film
from cldit.spray.droplet.fluids import Fuel, Gas

_PROBE_K = 0.01
_TEMPERATURE_SCALE_K = 100.0  # an error of 1 % of this counts as much as one of 1 % in s
_NOTHING = 1e-6  # of s: 1e-9 of the mass
_MOST_ROUNDS = 3000
_CD = 0.44 / 24  # times Re: factor on Stokes' drag beyond Re = 1000


@dataclass(frozen=True)
class Droplets:
    """mass_kg of one droplet and temperature_K, (N,); velocity_m_s, (N, k), any k."""

    mass_kg: Floats
    temperature_K: Floats
    velocity_m_s: Floats


@dataclass(frozen=True)
class Surroundings:
    """The gas around each droplet, (N,); velocity_m_s, (N, k). vapour: mass fraction of fuel."""

    temperature_K: Floats
    pressure_Pa: Floats
    vapour: Floats
    velocity_m_s: Floats


@dataclass(frozen=True)
class Advance:
    """What became of the droplets, and what the gas received from one droplet of each.

    droplets: those that vanished have mass 0, the gas's velocity and their last temperature.
    gone_s: when each vanished; inf for those that are left.
    path_m: way of each since the start, (N, k), until it vanished.
    mass_kg, enthalpy_J (N,), momentum_kg_m_s (N, k): lost by the liquid, so that what the gas gets
        and what the liquid has left add up. Enthalpies are on the zero of `fuel.liquid`.
    steps: taken by the busiest droplet, rejected ones among them.
    """

    droplets: Droplets
    gone_s: Floats
    path_m: Floats
    mass_kg: Floats
    enthalpy_J: Floats
    momentum_kg_m_s: Floats
    steps: int


def advance(
    droplets: Droplets,
    surroundings: Surroundings,
    duration_s: float,
    *,
    fuel: Fuel,
    gas: Gas,
    model: Model,
    tolerance: float = 1e-3,
    drag: bool = True,
) -> Advance:
    """Follows droplets for a while; any duration is allowed, steps inside are chosen here.

    Args:
        tolerance: error allowed in a step, in s and in 100 K; inf takes the duration as one step.
        drag: without it the velocities stay (a droplet on a fibre).

    Raises:
        SprayError: impossible droplets or surroundings; a droplet cannot be followed.
    """
    _check(droplets, surroundings, duration_s, fuel)
    mass = droplets.mass_kg.astype(float)
    temperature = droplets.temperature_K.astype(float)
    velocity = droplets.velocity_m_s.astype(float)
    count = mass.size
    elapsed, trial = np.zeros(count), np.full(count, duration_s)
    gone, path = np.full(count, np.inf), np.zeros_like(velocity)
    active = np.flatnonzero(mass > 0)
    gone[mass <= 0] = 0.0
    rounds = 0
    while active.size and duration_s > 0:
        rounds += 1
        if rounds > _MOST_ROUNDS:
            raise SprayError(_stuck(fuel, mass, temperature, surroundings, int(active[0])))
        around = Surroundings(
            surroundings.temperature_K[active],
            surroundings.pressure_Pa[active],
            surroundings.vapour[active],
            surroundings.velocity_m_s[active],
        )
        slip = velocity[active] - around.velocity_m_s
        left = duration_s - elapsed[active]
        asked = np.minimum(trial[active], left)
        found = _step(
            mass[active],
            temperature[active],
            np.linalg.norm(slip, axis=1),
            asked,
            around=around,
            rates=_rates(around, fuel, gas, model),
            fuel=fuel,
            drag=drag,
        )
        error = found.error / tolerance
        good = np.isfinite(found.temperature_K) & (error <= 1.0)
        keep = active[good]
        mass[keep] *= found.s[good] ** 1.5
        temperature[keep] = found.temperature_K[good]
        now = slip * found.slip_ratio[:, None]
        if drag:
            velocity[keep] = around.velocity_m_s[good] + now[good]
        path[keep] += (around.velocity_m_s * found.time_s[:, None] + slip * found.slip_s[:, None])[
            good
        ]
        elapsed[keep] += found.time_s[good]
        ended = good & (found.s <= _NOTHING)
        mass[active[ended]] = 0.0
        gone[active[ended]] = np.minimum(elapsed[active[ended]], duration_s)
        with np.errstate(divide="ignore"):
            factor = np.clip(0.9 / np.sqrt(error), 0.2, 4.0)
        # A step that the end of the duration cut short says nothing against the one before it.
        cut = good & (asked < trial[active])
        length = np.where(np.isfinite(factor), factor, 0.2) * found.time_s
        trial[active] = np.where(cut, np.maximum(trial[active], length), length)
        done = ended | (good & (elapsed[active] >= duration_s * (1 - 1e-12)))
        active = active[~done]
    heat = fuel.liquid.one("enthalpy", temperature)
    heat0 = fuel.liquid.one("enthalpy", droplets.temperature_K)
    return Advance(
        droplets=Droplets(mass, temperature, velocity),
        gone_s=gone,
        path_m=path,
        mass_kg=droplets.mass_kg - mass,
        enthalpy_J=droplets.mass_kg * heat0 - mass * heat,
        momentum_kg_m_s=droplets.mass_kg[:, None] * droplets.velocity_m_s
        - mass[:, None] * velocity,
        steps=rounds,
    )


_Rates = Callable[[Floats, Floats, Floats], tuple[Floats, Floats, Drop]]


def _rates(around: Surroundings, fuel: Fuel, gas: Gas, model: Model) -> _Rates:
    """-d(ln s)/dt and dT/dt of droplets of a mass, temperature and slip; and the drops."""

    def rates(mass: Floats, temperature: Floats, slip: Floats) -> tuple[Floats, Floats, Drop]:
        drop = Drop(
            fuel=fuel,
            gas=gas,
            diameter_m=fuel.diameter_m(mass, temperature),
            temperature_K=temperature,
            gas_temperature_K=around.temperature_K,
            pressure_Pa=around.pressure_Pa,
            vapour=around.vapour,
            slip_m_s=slip,
        )
        found = model(drop)
        cp = fuel.liquid.one("cp", temperature)
        return 2 / 3 * found.mass_kg_s / mass, found.heat_W / (mass * cp), drop

    return rates


@dataclass(frozen=True)
class _Step:
    """s: what is left of d^2, 0 where the droplet vanished after time_s. slip_ratio: of the slip
    at the end to that at the start. slip_s: integral of it over time. error: the largest part."""

    s: Floats
    temperature_K: Floats
    slip_ratio: Floats
    slip_s: Floats
    time_s: Floats
    error: Floats


def _step(
    mass: Floats,
    temperature: Floats,
    slip: Floats,
    time: Floats,
    *,
    around: Surroundings,
    rates: _Rates,
    fuel: Fuel,
    drag: bool,
) -> _Step:
    shrink, warm, drop = rates(mass, temperature, slip)
    shrink_probe, warm_probe, _ = rates(mass, temperature + _PROBE_K, slip)
    jacobian = np.minimum((warm_probe - warm) / _PROBE_K, 0.0)
    shrink_slope = (shrink_probe - shrink) / _PROBE_K

    # Predicted: rates linear in temperature, which relaxes in theta; exact for those.
    rise = _mean_rise(warm, jacobian, shrink, time)
    predicted = shrink + shrink_slope * rise
    with np.errstate(divide="ignore"):
        vanish = np.where(predicted > 0, 1 / np.where(predicted > 0, predicted, 1.0), np.inf)
    time = np.minimum(time, vanish)
    theta = _theta(predicted, time)
    low, high = fuel.liquid.low_K, fuel.liquid.high_K
    change = np.clip(temperature + _relaxed(warm, jacobian, theta), low, high) - temperature
    s = np.maximum(1 - predicted * time, _NOTHING)
    end_mass = mass * s**1.5
    state = film(drop)
    drag_of = _Drag(drop, state.density_kg_m3, slip) if drag else None
    ratio = drag_of.ratio(state.viscosity_Pa_s, theta, s) if drag_of else np.ones_like(slip)

    # Corrected: what the rates at the end differ by grows evenly along the step.
    shrink_end, warm_end, drop_end = rates(end_mass, temperature + change, slip * ratio)
    rest = s * warm_end - warm - jacobian * change
    shift = _relaxed_ramp(rest, jacobian, theta)
    final = np.clip(temperature + change + shift, low, high)
    more = 0.5 * (s * shrink_end - shrink - shrink_slope * change)
    shrink_mean = predicted + more
    s_end = 1 - shrink_mean * time
    gone = s_end <= _NOTHING
    error = np.abs(more) * time
    error = np.maximum(error, np.where(gone, 0.0, np.abs(shift) / _TEMPERATURE_SCALE_K))
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.where(gone, np.minimum(time, 1 / shrink_mean), time)
    if drag_of:
        middle = 0.5 * (state.viscosity_Pa_s + film(drop_end).viscosity_Pa_s)
        theta = np.where(gone, np.inf, _theta(shrink_mean, time))
        better = drag_of.ratio(middle, theta, np.maximum(s_end, 0.0))
        error = np.maximum(error, np.abs(better - ratio) * slip / (slip + 1.0))
        ratio = better
    return _Step(
        s=np.where(gone, 0.0, s_end),
        temperature_K=final,
        slip_ratio=ratio,
        slip_s=time * _log_mean(ratio),
        time_s=time,
        error=np.where(np.isfinite(error), error, np.inf),
    )


class _Drag:
    """Schiller and Naumann up to Re = 1000, then Cd = 0.44: slip against theta in closed form."""

    def __init__(self, drop: Drop, density_kg_m3: Floats, slip: Floats) -> None:
        self._density = drop.fuel.liquid.one("density", drop.temperature_K)
        self._diameter = drop.diameter_m
        self._flow = density_kg_m3 * slip * drop.diameter_m

    def ratio(self, viscosity_Pa_s: Floats, theta: Floats, s: Floats) -> Floats:
        """Of the slip after theta to that before; Re is that of the mean diameter."""
        within = np.where(np.isinf(theta), 0.0, theta)
        relaxations = within * 18 * viscosity_Pa_s / (self._density * self._diameter**2)
        reynolds = self._flow / viscosity_Pa_s * 0.5 * (1 + np.sqrt(s))
        # First with constant Cd until Re is 1000, if it is above; then as Schiller and Naumann.
        high = np.maximum(reynolds, 1e3)
        fast = np.minimum(relaxations, (high / 1e3 - 1) / (_CD * high))
        factor = 1 / (1 + _CD * reynolds * fast)
        weight = 0.15 * np.minimum(reynolds, 1e3) ** 0.687
        growth = np.exp(np.minimum(0.687 * (relaxations - fast), 600.0))
        ratio = factor * ((1 + weight) * growth - weight) ** (-1 / 0.687)
        return np.where(np.isinf(theta), 0.0, ratio)


def _theta(shrink: Floats, time: Floats) -> Floats:
    """Integral of dt / s for s = 1 - shrink t; inf where the droplet vanishes."""
    x = np.minimum(shrink * time, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.where(x > 1 - 1e-12, np.inf, -np.log1p(-x) / shrink)
    return np.where(np.abs(x) < 1e-8, time * (1 + x / 2), exact)


def _firm(jacobian: Floats, theta: Floats) -> Floats:
    """Never so close to zero that differences cancel: at 1e-6 of the step nothing changes."""
    return np.asarray(np.minimum(jacobian, -1e-6 / np.minimum(theta, 1e6)))


def _relaxed(rate: Floats, jacobian: Floats, theta: Floats) -> Floats:
    """Rise by theta of what starts at `rate` and relaxes by `jacobian`."""
    j = _firm(jacobian, theta)
    return np.asarray(rate * np.expm1(j * theta) / j)


def _relaxed_ramp(rest: Floats, jacobian: Floats, theta: Floats) -> Floats:
    """The same for a rate that grows evenly from 0 to `rest`."""
    j = _firm(jacobian, theta)
    z = j * theta
    with np.errstate(invalid="ignore"):
        weight = np.where(np.isinf(z), 0.0, np.expm1(z) / z) - 1
    near = np.abs(z) < 1e-4  # where the difference would cancel; theta is finite there
    series = np.where(near, theta, 0.0) * (0.5 + np.where(near, z, 0.0) / 6)
    return np.asarray(rest * np.where(near, series, weight / j))


def _mean_rise(rate: Floats, jacobian: Floats, shrink: Floats, time: Floats) -> Floats:
    """Mean over the time (or the life, if shorter) of a rise that relaxes in theta."""
    theta = _theta(shrink, time)
    life = np.minimum(time, np.where(shrink > 0, 1 / np.where(shrink > 0, shrink, 1.0), np.inf))
    j = _firm(jacobian, theta)
    y = j - shrink
    y = np.where(y == 0, j, y)
    with np.errstate(invalid="ignore"):
        weighted = np.where(np.isinf(theta), -1 / y, np.expm1(y * theta) / y)
    return np.asarray(rate / j * (weighted / life - 1))


def _log_mean(ratio: Floats) -> Floats:
    """Mean of an exponential that falls from 1 to `ratio`; 0 for one that falls to nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (ratio - 1) / np.log(ratio)
    return np.where(ratio > 1 - 1e-9, 1.0, np.where(ratio > 0, mean, 0.0))


def _check(droplets: Droplets, around: Surroundings, duration_s: float, fuel: Fuel) -> None:
    mass, temperature = droplets.mass_kg, droplets.temperature_K
    checks = (
        ("mass_kg of a droplet", mass, 0.0, 1e-3),
        ("temperature_K of a droplet", temperature, fuel.liquid.low_K, fuel.liquid.high_K),
        ("temperature_K of the gas", around.temperature_K, 80.0, fuel.vapour.high_K),
        ("pressure_Pa of the gas", around.pressure_Pa, 1e3, fuel.highest_Pa),
        ("vapour, mass fraction in the gas,", around.vapour, 0.0, 1.0),
        ("duration_s", np.asarray([duration_s]), 0.0, 1e9),
    )
    for name, values, low, high in checks:
        bad = ~((values >= low) & (values <= high))
        if np.any(bad):
            value = values[bad][0]
            raise SprayError(
                f"{fuel.name}: {name} is {value:g} (of {bad.sum()} in all); allowed are {low:g} "
                f"to {high:g}"
            )
    for name, speeds in (("droplet", droplets.velocity_m_s), ("gas", around.velocity_m_s)):
        if not np.all(np.abs(speeds) < 1e4):
            raise SprayError(f"velocity_m_s of the {name} is not finite, or above 10 km/s")


def _stuck(fuel: Fuel, mass: Floats, temperature: Floats, around: Surroundings, at: int) -> str:
    return (
        f"droplet {at} of {fuel.name} cannot be followed: mass {mass[at]:g} kg, "
        f"{temperature[at]:g} K, in gas of {around.temperature_K[at]:g} K, "
        f"{around.pressure_Pa[at]:g} Pa, vapour {around.vapour[at]:g}"
    )
