"""How far a computed spray has come, and how large its droplets are: what tables and tests read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.coupling import Cloud
from cldit.spray.flow.gas import GasFlow

Floats = NDArray[np.float64]

LIQUID_SHARE = 0.03  # of the fuel injected so far is liquid beyond the liquid penetration
VAPOUR_SHARE = 1e-3  # mass fraction at the edge of the vapour
STATION_m = 15e-3  # below the injector: where the ECN has droplets measured


@dataclass(frozen=True)
class History:
    """Columns against time, (M,). Penetrations are distances from the injector's tip; `axial_m` is
    that of the liquid along the injector's axis. The liquid's is a fixed amount of fuel, as a
    threshold of an optical instrument is, not a share of the liquid that is left: a few last
    droplets far away would count as a spray. The vapour's is the mean over the plumes, for the
    farthest cell of eight varies more from seed to seed."""

    time_s: Floats
    injected_kg: Floats
    liquid_kg: Floats
    vapour_kg: Floats
    sauter_mean_diameter_m: Floats
    liquid_m: Floats
    vapour_m: Floats
    axial_m: Floats
    coldest_K: Floats


def measures(
    cloud: Cloud, flow: GasFlow, fuel: Fuel, axes: Floats, *, injected_kg: float
) -> tuple[float, ...]:
    """The columns of `History` after the injected mass; axes (H, 3) of the holes."""
    mass = cloud.liquid_kg
    diameter = fuel.diameter_m(cloud.mass_kg, cloud.temperature_K)
    distance = np.linalg.norm(cloud.position_m, axis=1)
    return (
        float(mass.sum()),
        float(flow.fuel.sum() * flow.box.cell_m3),
        sauter_m(cloud.droplets, diameter),
        reach(distance, mass, LIQUID_SHARE * injected_kg),
        vapour_reach_m(flow, axes),
        reach(-cloud.position_m[:, 2], mass, LIQUID_SHARE * injected_kg),
        float(flow.temperature_K.min()),
    )


def vapour_reach_m(flow: GasFlow, axes: Floats) -> float:
    """Mean over the plumes, those that have vapour, of the farthest cell at `VAPOUR_SHARE`; a cell
    belongs to the plume whose axis (H, 3) points most to it."""
    rich = np.argwhere(flow.share >= VAPOUR_SHARE)
    if not len(rich):
        return 0.0
    centre = flow.box.origin_m + (rich + 0.5) * flow.box.spacing_m
    farthest = np.zeros(len(axes))
    np.maximum.at(farthest, np.argmax(centre @ axes.T, axis=1), np.linalg.norm(centre, axis=1))
    return float(farthest[farthest > 0].mean())


def sauter_m(droplets: Floats, diameter_m: Floats) -> float:
    """Sauter mean diameter; NaN without droplets."""
    area = float(np.sum(droplets * diameter_m**2))
    return float(np.sum(droplets * diameter_m**3)) / area if area > 0 else float("nan")


def reach(values: Floats, weights: Floats, beyond: float) -> float:
    """Value above which the weights sum up to `beyond`; 0 where all of them are less."""
    order = np.argsort(-values)
    above = np.cumsum(weights[order])
    place = int(np.searchsorted(above, beyond * (1 - 1e-12)))
    return float(values[order][place]) if place < len(order) else 0.0


class Station:
    """Droplets that passed the plane `STATION_m` below the injector, as an instrument there counts
    them over the whole injection."""

    def __init__(self) -> None:
        self._droplets: list[Floats] = []
        self._diameters: list[Floats] = []

    def watch(self, before: Cloud, after: Cloud, fuel: Fuel) -> None:
        """Parcels before and after a step, in the same order."""
        passed = (before.position_m[:, 2] > -STATION_m) & (after.position_m[:, 2] <= -STATION_m)
        passed &= after.mass_kg > 0
        self._droplets.append(after.droplets[passed])
        found = fuel.diameter_m(after.mass_kg[passed], after.temperature_K[passed])
        self._diameters.append(found)

    @property
    def sauter_m(self) -> float:
        if not self._droplets:
            return float("nan")
        return sauter_m(np.concatenate(self._droplets), np.concatenate(self._diameters))
