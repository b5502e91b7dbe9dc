"""Evaporation of the droplets of one plume of a `cone` spray, in the gas of that plume.

The eddies of a jet are as wide as its radius, so that they carry a droplet through the whole cross
section on its way. So all droplets of one size class have one history: in the mean gas of the cross
section, weighted by the fuel, with the vapour and the temperature that their own evaporation has
made, and at the speed of the jet, to which drag brings them. Each class follows its own heat, mass
and slip after Abramzon and Sirignano (`spray.droplet`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.jet import MEAN_SQUARE, Jet, profile, speed_profile
from cldit.spray.cone.mixing import Mixture
from cldit.spray.cone.wet_bulb import fluids
from cldit.spray.droplet.evaporation import MODELS
from cldit.spray.droplet.integrator import DropletStates, DropletSurroundings, advance
from cldit.spray.sizes import strata_m

ROUNDING = 0.4  # lag of the plume's edge behind its axis, over the time
_RINGS = 9  # of equal area
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
    """Evaporated share (A,) of the fuel of a plume by its age (A,), which rises."""

    age_s: Floats
    share: Floats

    def __call__(self, age_s: Floats) -> Floats:
        """Share 0..1 at ages, any shape."""
        return np.interp(age_s, self.age_s, self.share)


Rule = Callable[[Floats], Floats]


def at_once(age_s: Floats) -> Floats:
    """Kinetics of a gaseous fuel, or of one that exchanges nothing: share 1."""
    return np.ones(np.shape(age_s))


def plume_kinetics(
    spec: ConeSpray,
    jet: Jet,
    mixture: Mixture,
    *,
    oldest_s: float,
    rings: int = _RINGS,
    classes: int = _CLASSES,
    steps: int = _STEPS,
) -> Kinetics:
    """Evaporation along a plume up to the age `oldest_s`, by `steps` rising in length."""
    fuel, carrier = fluids()
    assert spec.droplets is not None
    age = np.append(0.0, np.geomspace(_FIRST, 1.0, steps)) * oldest_s
    xi2 = (np.arange(rings) + 0.5) / rings
    middle = 0.5 * (age[1:] + age[:-1])[:, None] * _lag(xi2)
    along = np.geomspace(1e-6, 1.0, 4000) * jet.tip_m(float(middle.max()))
    s = np.interp(middle, jet.travel_s(along), along)
    ratio = jet.axis_ratio(s) * profile(np.sqrt(xi2))
    speed = jet.mean_speed_m_s(s) * speed_profile(np.sqrt(xi2))
    diameter = strata_m(spec.droplets, classes)
    hot = np.full(classes, spec.fuel_temperature_K)
    start = fuel.mass_kg(diameter, hot)
    drops = DropletStates(start, hot, np.full((classes, 1), jet.speed_m_s))
    pressure = np.full(classes, spec.ambient.pressure_Pa)

    share = np.zeros(len(age))
    for n, (b, u) in enumerate(zip(ratio, speed, strict=True)):
        done = np.full(rings, share[n])
        vapour = b * mixture.evaporated(b, done)
        fuel_here = mixture.content(b, done)
        around = (mixture.gas_at(b, done), vapour / (1 + vapour), u)
        gas_K, fraction, gas_m_s = (
            np.full(classes, np.average(each, weights=fuel_here)) for each in around
        )
        drops = advance(
            drops,
            DropletSurroundings(gas_K, pressure, fraction, gas_m_s[:, None]),
            float(age[n + 1] - age[n]),
            fuel=fuel,
            gas=carrier,
            model=MODELS["abramzon-sirignano"],
            tolerance=_TOLERANCE,
        ).droplets
        share[n + 1] = np.clip(1 - np.mean(drops.mass_kg / start), share[n], 1.0)
    return Kinetics(age, share)
