"""Evaporation of the droplets of one plume of a `cone` spray, in the gas of that plume.

The eddies of a jet are as wide as its radius, so that they carry a droplet through the whole cross
section on its way. So all droplets of one size class have one history: in the mean gas of the cross
section, weighted by the fuel, with the vapour and the temperature that their own evaporation has
made, and at the speed of the jet, to which drag brings them. Each class follows its own heat, mass
and slip after Abramzon and Sirignano (`spray.droplet`).

The gas of a step depends on the steps before it alone. So whole histories are computed in the gas
of the previous ones until they do not change (Picard iteration): after k of them k steps are final.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.jet import MEAN_SQUARE, Jet, profile, speed_profile
from cldit.spray.cone.mixing import Mixture
from cldit.spray.droplet.advance import (
    GAS_TOLERANCE,
    DropletStates,
    DropletSurroundings,
    follow_droplets,
)
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.sizes import strata_m

ROUNDING = 0.4  # lag of the plume's edge behind its axis, over the time


def lag(xi2: Floats) -> Floats:
    """Speed across the plume over its mean: the edge lags behind the axis."""
    return np.asarray(1 - ROUNDING * (xi2 - MEAN_SQUARE))


@dataclass(frozen=True)
class Kinetics:
    """Droplets of a plume by their age (A,), which rises, and class of equal mass: (A, C) each.

    liquid: liquid share. distance_m, speed_m_s: from the hole; droplets are ahead of the gas that
    left with them, the large ones by most.
    """

    age_s: Floats
    liquid: Floats
    distance_m: Floats
    speed_m_s: Floats

    def share(self, age_s: Floats) -> Floats:
        """Evaporated share 0..1 of the fuel at ages, any shape."""
        return np.asarray(np.interp(age_s, self.age_s, 1 - self.liquid.mean(axis=1)))


def plume_kinetics(
    spec: ConeSpray,
    jet: Jet,
    mixture: Mixture,
    kernels: DropletKernels,
    *,
    oldest_s: float,
    rings: int = 9,
    classes: int = 8,
    steps: int = 120,
) -> Kinetics:
    """Evaporation along a plume up to the age `oldest_s`, by `steps` rising in length.

    Twice as many change the evaporated share of `gdi-cone` by at most 7e-4 (`rings` of equal area),
    5e-3 (`classes` of size) and 9e-4 (`steps`).
    """
    # The first step is a thousandth of the last age.
    age = np.append(0.0, np.geomspace(1e-3, 1.0, steps)) * oldest_s
    xi = np.sqrt((np.arange(rings) + 0.5) / rings)
    diameter = strata_m(spec.droplets, classes)
    hot = np.full(classes, spec.fuel_temperature_K)
    start = kernels.fuel.mass_kg(diameter, hot)
    drops = DropletStates(start, hot, np.full((classes, 1), jet.speed_m_s))
    step = np.diff(age)[:, None]
    liquid = np.ones((len(age), classes))
    speed = jet.speed_m_s * liquid
    way = np.linspace(0.0, jet.speed_m_s * oldest_s, 4 * len(age))
    distance = np.repeat(np.interp(age, jet.travel_s(way), way)[:, None], classes, axis=1)
    for _ in range(len(age)):
        s = distance[:-1] + 0.5 * step * speed[:-1]
        mean = np.maximum.accumulate(distance.mean(axis=1))
        gone = np.interp(np.minimum(s, mean[:-1, None]), mean, 1 - liquid.mean(axis=1))
        done = np.broadcast_to(gone[..., None], (*gone.shape, rings))
        ratio = jet.axis_ratio(s)[..., None] * profile(xi)
        vapour = ratio * mixture.evaporated(ratio, done)
        content = mixture.content(ratio, done)
        fields = (
            mixture.gas_at(ratio, done),
            vapour / (1 + vapour),
            jet.mean_speed_m_s(s)[..., None] * speed_profile(xi),
        )
        gas_K, fraction, gas_m_s = (np.average(field, axis=-1, weights=content) for field in fields)
        pressure = np.full(gas_K.shape, spec.ambient.pressure_Pa)
        gas = DropletSurroundings(gas_K, pressure, fraction, gas_m_s)
        mass, velocity = follow_droplets(drops, gas, step[:, 0], kernels, tolerance=GAS_TOLERANCE)
        previous = liquid.copy(), distance.copy()
        liquid[1:] = np.minimum.accumulate(np.minimum(mass / start, 1.0))
        speed[1:] = np.where(liquid[1:] > 0, velocity, gas_m_s)
        distance[1:] = np.cumsum(0.5 * step * (speed[:-1] + speed[1:]), axis=0)
        moved = np.abs(distance - previous[1]).max() / distance.max()
        if max(moved, np.abs(liquid - previous[0]).max()) < 1e-6:
            break
    return Kinetics(age, liquid, distance, speed)
