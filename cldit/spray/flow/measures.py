"""Penetrations, droplet sizes and other measures of a computed spray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.coupling import FlyingParcels
from cldit.spray.flow.exchange import FACES, gather
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.projection import projected_reach_m

Floats = NDArray[np.float64]

VAPOUR_SHARE = 1e-3  # the vapour's edge, as a mass fraction
STATION_m = 15e-3  # below the injector, where the ECN measures droplets


@dataclass(frozen=True)
class History:
    """Columns over time, (M,).

    Penetrations are distances from the injector's tip: of the liquid along the injector's axis
    (`projected_reach_m`), `thin_liquid_m` for the lower of the two thresholds; of the vapour along
    the plumes, as their mean, since the farthest cell of all has more scatter from seed to seed.
    axis_m_s: gas speed on the axis, `STATION_m` below the injector, away from it.
    """

    time_s: Floats
    injected_kg: Floats
    liquid_kg: Floats
    vapour_kg: Floats
    sauter_mean_diameter_m: Floats
    liquid_m: Floats
    thin_liquid_m: Floats
    vapour_m: Floats
    coldest_K: Floats
    axis_m_s: Floats


def measures(cloud: FlyingParcels, flow: GasFlow, fuel: Fuel, axes: Floats) -> tuple[float, ...]:
    """Values of `History` from liquid_kg on; `axes` (H, 3) are those of the holes."""
    diameter = fuel.diameter_m(cloud.mass_kg, cloud.temperature_K)
    volume = cloud.liquid_kg / fuel.liquid.one("density", cloud.temperature_K)
    liquid, thin = projected_reach_m(cloud.position_m, volume)
    return (
        float(cloud.liquid_kg.sum()),
        float(flow.fuel.sum() * flow.box.cell_m3),
        sauter_m(cloud.droplets, diameter),
        liquid,
        thin,
        vapour_reach_m(flow, axes),
        float(flow.temperature_K.min()),
        axis_m_s(flow),
    )


def axis_m_s(flow: GasFlow) -> float:
    """Gas speed on the injector's axis at `STATION_m`, away from it; NaN if the box ends above."""
    if flow.box.origin_m[2] > -STATION_m:
        return float("nan")
    there = np.array([[0.0, 0.0, -STATION_m]])
    return 0.0 - float(gather(flow.box, there, flow.velocity[2], FACES[2])[0])


def vapour_reach_m(flow: GasFlow, axes: Floats) -> float:
    """Largest distance of the share `VAPOUR_SHARE`: mean over plumes that have vapour.

    It is that of the farthest cell, plus a linear interpolation over the next cell outwards. A cell
    belongs to the plume whose axis, of `axes` (H, 3), is closest to its direction.
    """
    box, share = flow.box, flow.share
    rich = np.argwhere(share >= VAPOUR_SHARE)
    if not len(rich):
        return 0.0
    centre = box.origin_m + (rich + 0.5) * box.spacing_m
    plume, distance = np.argmax(centre @ axes.T, axis=1), np.linalg.norm(centre, axis=1)
    order = np.lexsort((distance, plume))
    last = order[np.append(np.diff(plume[order]) > 0, True)]  # the farthest of each plume
    here = share[tuple(rich[last].T)]
    on = centre[last] * (1 + box.spacing_m / distance[last])[:, None]
    fall = here - gather(box, on, share)
    above = here - VAPOUR_SHARE
    part = np.divide(above, fall, out=np.ones_like(fall), where=fall > above)
    return float(np.mean(distance[last] + part * box.spacing_m))


def sauter_m(droplets: Floats, diameter_m: Floats) -> float:
    """Sauter mean diameter of droplets (N,) of diameters (N,); NaN without droplets."""
    area = float(np.sum(droplets * diameter_m**2))
    return float(np.sum(droplets * diameter_m**3)) / area if area > 0 else float("nan")


def half_angle_rad(flow: GasFlow, axes: Floats) -> float:
    """Half angle of a cone as wide as the mean plume, at the edge of the vapour.

    It is measured from one to two thirds of the length along `axes` (H, 3); NaN without plumes.
    """
    index = np.stack(np.unravel_index(np.flatnonzero(flow.share >= VAPOUR_SHARE), flow.box.shape))
    centre = flow.box.origin_m + (index.T + 0.5) * flow.box.spacing_m
    along = np.max(centre @ axes.T, axis=1, initial=0.0)
    tip = vapour_reach_m(flow, axes)
    between = along[(along > tip / 3) & (along < 2 * tip / 3)]
    if not between.size:
        return float("nan")
    # Volume of the cone's part: pi/3 tan^2 (b^3 - a^3).
    volume = between.size * flow.box.cell_m3 / len(axes)
    square = 3 * volume / np.pi / (tip**3 * (8 - 1) / 27)
    return float(np.arctan(np.sqrt(square)))


class Station:
    """Counter of droplets that cross the plane `STATION_m` below the injector."""

    def __init__(self) -> None:
        self._droplets: list[Floats] = []
        self._diameters: list[Floats] = []

    def watch(self, before: FlyingParcels, after: FlyingParcels, fuel: Fuel) -> None:
        """Counts the droplets that cross in a step; parcels before and after have one order."""
        passed = (before.position_m[:, 2] > -STATION_m) & (after.position_m[:, 2] <= -STATION_m)
        passed &= after.mass_kg > 0
        self._droplets.append(after.droplets[passed])
        found = fuel.diameter_m(after.mass_kg[passed], after.temperature_K[passed])
        self._diameters.append(found)

    @property
    def sauter_m(self) -> float:
        """Sauter mean diameter of the counted droplets; NaN if there are none."""
        if not self._droplets:
            return float("nan")
        return sauter_m(np.concatenate(self._droplets), np.concatenate(self._diameters))
