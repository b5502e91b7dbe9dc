"""Penetrations, droplet sizes and other measures of a computed spray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.parcels import FlyingParcels, STATION_m
from cldit.spray.flow.projected import projected_reach_m

VAPOUR_SHARE = 1e-3  # the vapour's edge, as a mass fraction


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
    volume = cloud.liquid_kg / fuel.liquid.value("density", cloud.temperature_K)
    liquid, thin = projected_reach_m(cloud.position_m, volume)
    return (
        float(cloud.liquid_kg.sum()),
        flow.fuel_kg,
        sauter_m(cloud.droplets, diameter),
        liquid,
        thin,
        vapour_reach_m(flow, axes),
        float(flow.read("temperature").min()),
        axis_m_s(flow),
    )


def axis_m_s(flow: GasFlow) -> float:
    """Gas speed on the injector's axis at `STATION_m`, away from it; NaN beyond the domain."""
    if flow.grid.radius_m[-1] < STATION_m:
        return float("nan")
    # Around the axis every direction shows the same speed along it: the mean over azimuths.
    grid = flow.grid
    down = np.array([0.0, 0.0, -1.0])
    cosine = grid.directions @ down
    best = np.isclose(cosine, cosine.max(), atol=1e-6)
    along = np.tensordot(grid.frame @ down, flow.read("velocity"), 1)[best].mean(axis=0)
    return float(np.interp(STATION_m, grid.middle[2], along))


def vapour_reach_m(flow: GasFlow, axes: Floats) -> float:
    """Largest distance of the share `VAPOUR_SHARE`: mean over plumes that have vapour.

    A ray belongs to the plume whose axis, of `axes` (H, 3), is closest to it. Of each plume it is
    the farthest shell of cells in which a ray has this share, and linear to the next shell.
    """
    owner, share, radius = flow.grid.nearest(axes), flow.read("share"), flow.grid.middle[2]
    reaches = []
    for plume in range(len(axes)):
        top = share[owner == plume].max(axis=0, initial=0.0)
        rich = np.flatnonzero(top >= VAPOUR_SHARE)
        if not rich.size:
            continue
        shell = int(rich[-1])
        if shell + 1 == len(radius):
            reaches.append(float(flow.grid.radius_m[-1]))
            continue
        part = (top[shell] - VAPOUR_SHARE) / (top[shell] - top[shell + 1])
        reaches.append(float(radius[shell] + part * (radius[shell + 1] - radius[shell])))
    return float(np.mean(reaches)) if reaches else 0.0


def sauter_m(droplets: Floats, diameter_m: Floats) -> float:
    """Sauter mean diameter of droplets (N,) of diameters (N,); NaN without droplets."""
    area = float(np.sum(droplets * diameter_m**2))
    return float(np.sum(droplets * diameter_m**3)) / area if area > 0 else float("nan")
