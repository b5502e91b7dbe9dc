"""How far a computed spray has come, and how large its droplets are: what tables and tests read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.coupling import Cloud
from cldit.spray.flow.exchange import scatter
from cldit.spray.flow.gas import Box, GasFlow

Floats = NDArray[np.float64]

# The Engine Combustion Network's edges of the liquid, volume for each area that is looked at:
# 2.0e-3 and 0.2e-3 mm3/mm2; and of the vapour, as a mass fraction.
PROJECTED_m = 2.0e-6
THIN_PROJECTED_m = 0.2e-6
VAPOUR_SHARE = 1e-3
STATION_m = 15e-3  # below the injector: where the ECN has droplets measured


@dataclass(frozen=True)
class History:
    """Columns against time, (M,). Penetrations are distances from the injector's tip: of the liquid
    along the injector's axis (`projected_reach_m`), `thin_liquid_m` to the lower of the two edges;
    of the vapour along the plumes, the mean over them, for the farthest cell of eight varies more
    from seed to seed."""

    time_s: Floats
    injected_kg: Floats
    liquid_kg: Floats
    vapour_kg: Floats
    sauter_mean_diameter_m: Floats
    liquid_m: Floats
    thin_liquid_m: Floats
    vapour_m: Floats
    coldest_K: Floats


def measures(cloud: Cloud, flow: GasFlow, fuel: Fuel, axes: Floats) -> tuple[float, ...]:
    """The columns of `History` after the injected mass; axes (H, 3) of the holes."""
    diameter = fuel.diameter_m(cloud.mass_kg, cloud.temperature_K)
    liquid, thin = projected_reach_m(cloud, flow.box, fuel)
    return (
        float(cloud.liquid_kg.sum()),
        float(flow.fuel.sum() * flow.box.cell_m3),
        sauter_m(cloud.droplets, diameter),
        liquid,
        thin,
        vapour_reach_m(flow, axes),
        float(flow.temperature_K.min()),
    )


def projected_reach_m(cloud: Cloud, box: Box, fuel: Fuel) -> tuple[float, float]:
    """Liquid penetration as the Engine Combustion Network defines it: the farthest distance along
    the injector's axis at which the liquid on a line of sight across that axis, as a volume for
    each area, is still at an edge, `PROJECTED_m` and `THIN_PROJECTED_m`; 0 where it never is.

    A picture's pixels are the box's cells, among which a parcel is shared as in its exchange with
    the gas; rows are interpolated between. The mean of two lines of sight, along x and y.
    """
    volume = cloud.liquid_kg / fuel.liquid.one("density", cloud.temperature_K)
    content = scatter(box, cloud.position_m, volume)
    tops = [content.sum(axis=axis).max(axis=0) * box.spacing_m for axis in (0, 1)]
    depth = -(box.origin_m[2] + (np.arange(box.shape[2]) + 0.5) * box.spacing_m)

    def farthest(top: Floats, edge: float) -> float:
        rows = np.flatnonzero(top > edge)
        if not rows.size:
            return 0.0
        row = int(rows[0])  # the lowest
        here, below = float(top[row]), float(top[row - 1]) if row > 0 else 0.0
        return float(depth[row]) + float(box.spacing_m) * (here - edge) / (here - below)

    def both(edge: float) -> float:
        return float(np.mean([farthest(top, edge) for top in tops]))

    return both(PROJECTED_m), both(THIN_PROJECTED_m)


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


def half_angle_rad(flow: GasFlow, axes: Floats) -> float:
    """Of a cone as wide as the plumes are on average, between one and two thirds of their length,
    to the vapour's edge; NaN without plumes."""
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
