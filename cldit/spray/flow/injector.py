"""Injection of all parcels, drawn in advance of the flow."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cldit.arrays import Floats, Ints
from cldit.errors import SprayError
from cldit.scene.spray import RAMP_S, LagrangianSpray
from cldit.spray.cone.jet import profile
from cldit.spray.cone.nozzle import (
    check_free_drops,
    flow_coefficient,
    liquid_speed_m_s,
    plume_axis,
)
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.result import PLASTIC
from cldit.spray.sizes import mean_diameter_m, quantile_m

MOST_PARCELS = 2_000_000


@dataclass(frozen=True)
class Injection:
    """Parcels in the order of their injection.

    axes (H, 3), jet_diameter_m (H,): direction of each hole, a unit vector, and diameter of a jet
    of its flow and speed. time_s, diameter_m, droplets (N,): start, size, real droplets; hole (N,):
    number of its hole; position_m, velocity_m_s (N, 3). density_kg_m3: of the liquid.
    flow_coefficient: ratio to the flow that fills the holes at this speed.
    """

    axes: Floats
    jet_diameter_m: Floats
    speed_m_s: float
    start_s: float
    end_s: float
    density_kg_m3: float
    flow_coefficient: float
    time_s: Floats
    hole: Ints
    diameter_m: Floats
    droplets: Floats
    position_m: Floats
    velocity_m_s: Floats


def inject(spec: LagrangianSpray, fuel: Fuel) -> Injection:
    """Draws the parcels of `spec` with its seed; their mass is the injected one to rounding.

    The speed is Bernoulli's times a velocity coefficient, constant in time. Directions fill the
    cone with the density of `jet.profile`. Raises SprayError if the pressure does not drive the
    mass through the holes, or if there are too many parcels.
    """
    sizes = spec.droplets
    assert sizes is not None, "a gas is injected by gas_jets.inject_gas"
    density = float(fuel.liquid.value("density", spec.fuel_temperature_K))
    speed = liquid_speed_m_s(spec, density)
    times, released = released_share(spec)
    top, coefficient, shares = hole_flows(spec, flux_kg_m2_s=density * speed)
    typical = float(fuel.mass_kg(mean_diameter_m(sizes, 3, 0), spec.fuel_temperature_K))
    parcels = spec.injected_mass_kg / (typical * spec.droplets_per_parcel)
    if parcels > MOST_PARCELS:
        minimum = spec.droplets_per_parcel * parcels / MOST_PARCELS
        raise SprayError(
            f"spray.droplets_per_parcel: {spec.droplets_per_parcel:g} gives {parcels:.3g} parcels; "
            f"at least {minimum:.3g}"
        )
    counts = [max(1, round(parcels * share)) for share in shares]
    counts = counts if spec.injected_mass_kg > 0 else [0] * len(counts)
    hole = np.repeat(np.arange(len(counts)), counts)
    level = [(np.arange(count) + 0.5) / count for count in counts]
    time = np.interp(np.concatenate(level), released, times)
    order = np.argsort(time, kind="stable")
    time, hole = time[order], hole[order]
    even = _even(hole, len(shares), np.random.default_rng(spec.seed))
    diameter = quantile_m(sizes, even[2], by="mass")
    check_free_drops(diameter.max(initial=0.0))
    droplet_kg = fuel.mass_kg(diameter, np.full(len(time), spec.fuel_temperature_K))
    axes = np.array([plume_axis(plume) for plume in spec.plumes])
    position, direction = _spread(spec, axes, hole, even)
    start_s, end_s = flowing_s(times, released)
    return Injection(
        axes=axes,
        jet_diameter_m=np.sqrt(4 * shares * top / (np.pi * density * speed)),
        speed_m_s=speed,
        start_s=start_s,
        end_s=end_s,
        density_kg_m3=density,
        flow_coefficient=coefficient,
        time_s=time,
        hole=hole,
        diameter_m=diameter,
        droplets=(shares / np.maximum(counts, 1))[hole] * spec.injected_mass_kg / droplet_kg,
        position_m=position,
        velocity_m_s=speed * direction,
    )


def hole_flows(spec: LagrangianSpray, *, flux_kg_m2_s: float) -> tuple[float, float, Floats]:
    """Largest flow in kg/s, its ratio to that of a flux which fills all holes, and the share of
    each hole (H,); raises SprayError if the ratio exceeds 1."""
    times, released = released_share(spec)
    shares = np.array([plume.mass_fraction for plume in spec.plumes])
    top = float(np.max(np.diff(released) / np.diff(times))) * spec.injected_mass_kg
    coefficient = flow_coefficient(spec, rate_kg_s=top, flux_kg_m2_s=flux_kg_m2_s)
    return top, coefficient, shares / shares.sum()


def released_share(spec: LagrangianSpray) -> tuple[Floats, Floats]:
    """Times (M,), and the share of the fuel that is injected until then."""
    if spec.rate is not None:
        at, flow = np.array(spec.rate, dtype=float).T
    else:
        end = spec.injection_duration_s
        ramp = min(RAMP_S, end / 2)
        at = np.array([0.0, ramp, end - ramp, end])
        flow = np.array([0.0, 1.0, 1.0, 0.0])
    parts = [np.linspace(a, b, 101) for a, b in pairwise(at)]
    fine = np.unique(np.concatenate(parts))
    rate = np.interp(fine, at, flow)
    released = np.concatenate([[0.0], np.cumsum(np.diff(fine) * 0.5 * (rate[1:] + rate[:-1]))])
    return fine, released / released[-1]


def flowing_s(times_s: Floats, released: Floats) -> tuple[float, float]:
    """Begin and end of the flow, of the shares `released` (M,) until times (M,)."""
    flowing = np.flatnonzero(np.diff(released) > 0)
    return float(times_s[flowing[0]]), float(times_s[flowing[-1] + 1])


def _spread(
    spec: LagrangianSpray, axes: Floats, hole: Ints, level: Floats
) -> tuple[Floats, Floats]:
    """Initial positions, on the discs of the holes, and directions (unit vectors) of the parcels.

    `level` (2, N) are their places in the cone, radius and angle, from 0 to 1.
    """
    helper = np.where(np.abs(axes[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(axes, helper)
    u /= np.linalg.norm(u, axis=1)[:, None]
    v = np.cross(axes, u)
    edge = np.tan(np.radians([plume.cone_angle_deg / 2 for plume in spec.plumes]))[hole]
    # Radius by inversion of the integral of 2 xi profile(xi).
    xi = np.linspace(0.0, 1.0, 400)
    inside = np.concatenate([[0.0], np.cumsum(np.diff(xi**2) * profile(0.5 * (xi[1:] + xi[:-1])))])
    size = np.interp(level[0], inside / inside[-1], xi)
    angle = 2 * np.pi * level[1]
    sideways = np.cos(angle)[:, None] * u[hole] + np.sin(angle)[:, None] * v[hole]
    direction = axes[hole] + (edge * size)[:, None] * sideways
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    start = (0.5 * spec.hole_diameter_m * size)[:, None] * sideways
    return start, direction


def _even(hole: Ints, holes: int, random: np.random.Generator) -> Floats:
    """Three numbers from 0 to 1 for each parcel, (3, N): radius, angle, and size by mass.

    For each hole they are a Kronecker sequence with a random shift (ratio^4 = ratio + 1), which
    fills the cube more uniformly than random numbers, at any time.
    """
    result = np.empty((3, len(hole)))
    for index in range(holes):
        members = hole == index
        count = np.arange(np.count_nonzero(members))
        for axis in range(3):
            result[axis, members] = (random.random() + count / PLASTIC ** (axis + 1)) % 1.0
    return result
