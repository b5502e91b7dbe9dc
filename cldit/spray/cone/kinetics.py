"""Evaporation of the droplets of one plume of a `cone` spray, in the gas of that plume.

Droplets of every size class travel with the fuel along lines of constant xi = radius / edge. They
see the mixture of their line, with the vapour and the temperature that their own evaporation has
made, and the speed of the jet, to which drag brings them. Each follows its own heat, mass and slip
after Abramzon and Sirignano (`spray.droplet`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.scene.spray import ConeSpray
from cldit.spray.cone.jet import MEAN_SQUARE, Jet, profile, speed_profile
from cldit.spray.cone.mixing import Mixture, bilinear
from cldit.spray.cone.wet_bulb import fluids
from cldit.spray.droplet.evaporation import MODELS
from cldit.spray.droplet.integrator import DropletStates, DropletSurroundings, advance
from cldit.spray.sizes import strata_m

Floats = NDArray[np.float64]

ROUNDING = 0.4  # lag of the plume's edge behind its axis, over the time
_LINES = 9
_CLASSES = 8
_STEPS = 120
_FIRST = 1e-3  # age of the first step, over the last
_TOLERANCE = 1e-2  # of a droplet's step


def age_s(travel_s: Floats, xi2: Floats) -> Floats:
    """Time since the fuel left the hole: the edge of the plume lags behind its axis."""
    return travel_s / _lag(xi2)


def _lag(xi2: Floats) -> Floats:
    return np.asarray(1 - ROUNDING * (xi2 - MEAN_SQUARE))


@dataclass(frozen=True)
class Kinetics:
    """Evaporated share (A, L) of the fuel of a plume by its age (A,) and by xi^2 (L,), rising."""

    age_s: Floats
    xi2: Floats
    share: Floats

    def __call__(self, age_s: Floats, xi2: Floats) -> Floats:
        """Share 0..1 at ages and xi^2 of one shape."""
        return bilinear(self.age_s, self.xi2, [self.share], age_s, xi2)[0]


Rule = Callable[[Floats, Floats], Floats]


def at_once(age_s: Floats, xi2: Floats) -> Floats:
    """Kinetics of a gaseous fuel, or of one that exchanges nothing: share 1."""
    return np.ones(np.broadcast_shapes(np.shape(age_s), np.shape(xi2)))


def plume_kinetics(
    spec: ConeSpray,
    jet: Jet,
    mixture: Mixture,
    *,
    oldest_s: float,
    lines: int = _LINES,
    classes: int = _CLASSES,
    steps: int = _STEPS,
) -> Kinetics:
    """Evaporation along a plume up to the age `oldest_s`, by `steps` rising in length."""
    fuel, carrier = fluids()
    assert spec.droplets is not None
    age = np.append(0.0, np.geomspace(_FIRST, 1.0, steps)) * oldest_s
    xi2 = np.linspace(0.0, 1.0, lines)
    middle = 0.5 * (age[1:] + age[:-1])[:, None] * _lag(xi2)
    along = np.geomspace(1e-6, 1.0, 4000) * jet.tip_m(float(middle.max()))
    s = np.interp(middle, jet.travel_s(along), along)
    ratio = jet.axis_ratio(s) * profile(np.sqrt(xi2))
    speed = jet.mean_speed_m_s(s) * speed_profile(np.sqrt(xi2))
    diameter = np.tile(strata_m(spec.droplets, classes), lines)
    hot = np.full(diameter.size, spec.fuel_temperature_K)
    start = fuel.mass_kg(diameter, hot)
    drops = DropletStates(start, hot, np.full((diameter.size, 1), jet.speed_m_s))
    pressure = np.full(diameter.size, spec.ambient.pressure_Pa)

    share = np.zeros((len(age), lines))
    for n, (b, u) in enumerate(zip(ratio, speed, strict=True)):
        vapour = b * mixture.evaporated(b, share[n])
        around = (mixture.gas_at(b, share[n]), vapour / (1 + vapour), u)
        gas_K, fraction, gas_m_s = (np.repeat(each, classes) for each in around)
        drops = advance(
            drops,
            DropletSurroundings(gas_K, pressure, fraction, gas_m_s[:, None]),
            float(age[n + 1] - age[n]),
            fuel=fuel,
            gas=carrier,
            model=MODELS["abramzon-sirignano"],
            tolerance=_TOLERANCE,
        ).droplets
        left = np.mean((drops.mass_kg / start).reshape(lines, classes), axis=1)
        share[n + 1] = np.clip(1 - left, 0.0, 1.0)
    return Kinetics(age, xi2, share)
