"""Plumes of a `cone` spray: width, path, and the fuel of each between its tip and its tail."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K
from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.attraction import displaced_m
from cldit.spray.cone.fluid_properties import NITROGEN_MOLAR_MASS_kg_mol
from cldit.spray.cone.jet import MEAN_SQUARE, Jet, profile
from cldit.spray.cone.kinetics import ROUNDING, Kinetics, lag, plume_kinetics
from cldit.spray.cone.nozzle import NozzleFlow, nozzle_flow, plume_axis, without_lattice

SOFTNESS = 0.1  # half the width of the tip, and of the droplets' tail, over the travel time
TRAILING = 0.9  # that of the gas's tail: the slow edge and the last, thin jet stay behind
RESOLVED = 1.5  # smallest radius of the plume, in cells
MOST_CELLS = 2e8  # in the boxes around all plumes
XI2 = np.linspace(0.0, 1.0, 17)  # of tables across a plume, (radius over edge)^2


@dataclass(frozen=True)
class Plume:
    """Plume from the nozzle along `axis`.

    radius_m, moved_m: its radius (A,) and displacement (A, 3) at distances (A,) from the jet's
    start. fuel: as `_evaporated`.
    """

    axis: Floats
    jet: Jet
    fuel: list[Floats]
    along_m: Floats
    radius_m: Floats
    moved_m: Floats

    @classmethod
    def of(
        cls,
        spec: ConeSpray,
        axis: Floats,
        jet: Jet,
        kinetics: Kinetics | None,
        source: NozzleFlow,
        *,
        path: tuple[Floats, Floats],
        reach_m: float,
    ) -> Plume:
        """Plume of a jet and its droplets on its path, up to a distance."""
        along = np.linspace(0.0, reach_m, 600)[1:]
        radius = _edge_m(jet, source, kinetics, along)
        moved = np.stack([np.interp(along, path[0], component) for component in path[1].T], axis=1)
        fuel = _evaporated(spec, jet, kinetics, along)
        return cls(axis, jet, fuel, along, radius, moved)

    @cached_property
    def projected_m(self) -> Floats:
        """Distances (A,) projected on the axis."""
        return np.asarray(self.along_m + self.moved_m @ self.axis)

    @cached_property
    def aside_m(self) -> Floats:
        """Displacement (A, 3) across the axis."""
        return np.asarray(self.moved_m - (self.moved_m @ self.axis)[:, None] * self.axis)

    @property
    def reach_m(self) -> float:
        """Distance of the farthest fuel from the start of the jet."""
        return float(self.along_m[-1])

    def width_m(self, edge_m: float) -> Floats:
        """Radius in cells of this edge, in which a plume that is finer than them is widened."""
        return np.hypot(self.radius_m, RESOLVED * edge_m)

    def box_m(self, edge_m: float, within_m: float = np.inf) -> tuple[Floats, Floats]:
        """Corners of the box around the plume `within_m` of the nozzle, in cells of this edge."""
        end = max(1, np.searchsorted(self.along_m, within_m, side="right"))
        across = self.width_m(edge_m)[:end, None] * np.sqrt(1 - self.axis**2)
        middle = self.along_m[:end, None] * self.axis + self.moved_m[:end]
        lower, upper = np.min(middle - across, axis=0), np.max(middle + across, axis=0)
        return np.minimum(lower, -across[0]), np.maximum(upper, across[0])

    def distance_m(self, radius_m: float) -> float:
        """Distance from the nozzle up to which the plume is narrower than a radius."""
        if self.radius_m[0] >= radius_m:
            return 0.0
        return float(np.interp(radius_m, self.radius_m, self.along_m))


def shares_of(spec: ConeSpray) -> list[float]:
    """Share of each plume in the fuel."""
    total = sum(plume.mass_fraction for plume in spec.plumes)
    return [plume.mass_fraction / total for plume in spec.plumes]


def plumes_of(spec: ConeSpray, device: Device) -> tuple[Plume, ...]:
    """All plumes; raises SprayError if the lattice does not suit one.

    Cones that differ only in lattice and size classes share them.
    """
    plumes = _plumes(without_lattice(spec), device)
    for plume in plumes:
        lower, upper = plume.box_m(spec.lattice_m)
        finest = float(np.prod(upper - lower) * len(plumes) / MOST_CELLS) ** (1 / 3)
        if not finest <= spec.lattice_m <= plume.reach_m / 2:
            raise SprayError(
                f"spray.spacing_m: {spec.lattice_m:g} does not suit a plume of "
                f"{plume.reach_m:.3g} m, one of {len(plumes)}; "
                f"allowed: {finest:.2g}..{plume.reach_m / 2:.2g}"
            )
    return plumes


@lru_cache(maxsize=4)
def _plumes(spec: ConeSpray, device: Device) -> tuple[Plume, ...]:
    source = nozzle_flow(spec, device)
    gas_kg_m3 = (
        spec.ambient.pressure_Pa
        * NITROGEN_MOLAR_MASS_kg_mol
        / (GAS_CONSTANT_J_mol_K * spec.ambient.temperature_K)
    )
    jets = [
        Jet(
            rate_kg_s=share * spec.injected_mass_kg / spec.injection_duration_s,
            speed_m_s=source.speed_m_s,
            half_angle_rad=float(np.radians(plume.cone_angle_deg / 2)),
            fuel_kg_m3=source.density_kg_m3,
            gas_kg_m3=gas_kg_m3,
        )
        for plume, share in zip(spec.plumes, shares_of(spec), strict=True)
    ]
    oldest_s = spec.time_s * (1 + SOFTNESS + ROUNDING * MEAN_SQUARE)
    reaches = [jet.tip_m(oldest_s) for jet in jets]
    axes = [plume_axis(plume) for plume in spec.plumes]
    kinetics: dict[Jet, Kinetics | None] = {}  # equal plumes share one
    plumes = []
    paths = displaced_m(axes, jets, reaches)
    for axis, jet, path, reach_m in zip(axes, jets, paths, reaches, strict=True):
        if jet not in kinetics:
            kinetics[jet] = _kinetics(spec, jet, source, oldest_s=oldest_s)
        if (droplets := kinetics[jet]) is not None:
            ahead = droplets.distance_m[droplets.age_s <= oldest_s][-1]
            reach_m = max(reach_m, float(ahead.max()))
        plumes.append(Plume.of(spec, axis, jet, kinetics[jet], source, path=path, reach_m=reach_m))
    return tuple(plumes)


def _kinetics(spec: ConeSpray, jet: Jet, source: NozzleFlow, *, oldest_s: float) -> Kinetics | None:
    if source.kernels is None:
        return None
    longest_s = oldest_s / float(lag(np.ones(())))
    return plume_kinetics(spec, jet, source.mixture, source.kernels, oldest_s=longest_s)


def _evaporated(
    spec: ConeSpray, jet: Jet, droplets: Kinetics | None, along_m: Floats
) -> list[Floats]:
    """Evaporated share of the fuel, and fuel over that of the steady plume, (A, `XI2`).

    Vapour moves with the gas. Droplets are ahead of it and faster, and none is younger than the end
    of injection.
    """
    distance, late = along_m[:, None], lag(XI2)
    trailing = SOFTNESS if droplets is None else TRAILING
    vapour = _present(spec, jet.travel_s(distance), XI2, trailing)
    if droplets is None:
        return [np.ones(vapour.shape), vapour]
    liquid_share, liquid = np.zeros(vapour.shape), np.zeros(vapour.shape)
    youngest_s = spec.time_s - spec.injection_duration_s
    for size in range(droplets.liquid.shape[1]):
        age = np.interp(distance, droplets.distance_m[:, size], droplets.age_s)
        speed = np.interp(age, droplets.age_s, droplets.speed_m_s[:, size])
        share = np.interp(
            np.clip(age / late, youngest_s, spec.time_s), droplets.age_s, droplets.liquid[:, size]
        )
        liquid_share += share / droplets.liquid.shape[1]
        slower = np.minimum(jet.mean_speed_m_s(distance) / speed, 1.0)
        liquid += share * slower * _present(spec, age, XI2, SOFTNESS) / droplets.liquid.shape[1]
    gone = (1 - liquid_share) * vapour
    fuel = gone + liquid
    return [np.divide(gone, fuel, out=np.ones_like(fuel), where=fuel > 0), fuel]


def _edge_m(
    jet: Jet,
    source: NozzleFlow,
    kinetics: Kinetics | None,
    along_m: Floats,
) -> Floats:
    """Radius of the plume at distances (N,), by the fuel per length, rate / speed."""
    xi = (np.arange(64) + 0.5) / 64
    ratio = jet.axis_ratio(along_m)[:, None] * profile(xi)
    share: ArrayLike = 1.0
    if kinetics is not None:
        share = kinetics.share(jet.travel_s(along_m)[:, None] / lag(xi * xi))
    content = source.mixture.content(ratio, share)
    mean = np.sum(content * 2 * xi / 64, axis=1)
    line = jet.rate_kg_s / jet.mean_speed_m_s(along_m)
    return np.asarray(np.sqrt(line / (np.pi * mean)))


def _present(spec: ConeSpray, travel_s: Floats, xi2: Floats, trailing: float) -> Floats:
    """Share (0..1) of the fuel between tip and tail, whose half width is `trailing`.

    Both steps are symmetric in the travel time and the mean lag of the edge is 0, so that the mass
    between tip and tail is the injected mass.
    """
    tip_s = spec.time_s * (1 - ROUNDING * (xi2 - MEAN_SQUARE))
    tail_s = tip_s - min(spec.injection_duration_s, spec.time_s) * (tip_s / spec.time_s)
    present = _smooth_step((tip_s - travel_s) / (SOFTNESS * spec.time_s))
    if spec.time_s <= spec.injection_duration_s:
        return present
    width = trailing * (spec.time_s - spec.injection_duration_s)
    return present * _smooth_step((travel_s - tail_s) / width)


def _smooth_step(x: Floats) -> Floats:
    """Smooth step: 0 below -1, 1 above 1, a cubic between."""
    t = np.clip((x + 1) / 2, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))
