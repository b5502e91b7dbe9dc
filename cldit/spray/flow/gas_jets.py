"""Jets of gas from the holes, as sources of the computed gas.

A jet leaves its notional nozzle (`notional_nozzle.py`) at the Mach disc. The source fills a
paraboloid from the tip to there, as the barrel of shocks does, in which the fuel is unmixed: each
of its sections has a part of the flow, at the speed and density of the notional nozzle. What is
given is mass, stagnation enthalpy and momentum.
"""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.scene.spray import LagrangianSpray
from cldit.spray.cone.nozzle import plume_axis, pressure_drop_Pa
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.injector import Injection, flowing_s, hole_flows, released_share
from cldit.spray.flow.mixture import LOWEST_K
from cldit.spray.flow.notional_nozzle import Expansion, expand
from cldit.spray.flow.parcels import FlyingParcels, REACH_m
from cldit.spray.flow.rays import RayGrid


def inject_gas(spec: LagrangianSpray, fuel: Fuel) -> tuple[Injection, Expansion]:
    """Holes with the flow of their notional nozzles, no parcels, and the expansion to them.

    Raises SprayError if the fuel is no gas, or if the pressure does not drive its flow.
    """
    _check_gas(spec, fuel)
    pressure_drop_Pa(spec)
    jet = expand(
        fuel,
        stagnation_Pa=spec.injection_pressure_Pa,
        stagnation_K=spec.fuel_temperature_K,
        pressure_Pa=spec.ambient.pressure_Pa,
    )
    least_K = max(LOWEST_K, fuel.vapour.low_K)
    if jet.temperature_K < least_K:
        raise SprayError(
            f"spray.fuel_temperature_K: {spec.fuel_temperature_K:g} falls to "
            f"{jet.temperature_K:.0f} K in the notional nozzle, and properties of {fuel.name} "
            f"begin at {least_K:.0f} K; allowed: hotter fuel, or a lower "
            "spray.injection_pressure_Pa"
        )
    times, released = released_share(spec)
    top, coefficient, shares = hole_flows(spec, flux_kg_m2_s=jet.flux_kg_m2_s)
    start_s, end_s = flowing_s(times, released)
    none = np.empty(0)
    return Injection(
        axes=np.array([plume_axis(plume) for plume in spec.plumes]),
        jet_diameter_m=jet.diameter_m(shares * top),
        speed_m_s=jet.speed_m_s,
        start_s=start_s,
        end_s=end_s,
        density_kg_m3=jet.density_kg_m3,
        flow_coefficient=coefficient,
        time_s=none,
        hole=np.empty(0, dtype=np.int64),
        diameter_m=none,
        droplets=none,
        position_m=np.empty((0, 3)),
        velocity_m_s=np.empty((0, 3)),
    ), jet


def _check_gas(spec: LagrangianSpray, fuel: Fuel) -> None:
    hot_K, pressure_Pa = spec.fuel_temperature_K, spec.injection_pressure_Pa
    least_K = fuel.critical_K
    if pressure_Pa < fuel.critical_Pa:
        least_K = min(least_K, float(fuel.boiling_K(pressure_Pa)))
    if not least_K < hot_K <= fuel.vapour.high_K:
        raise SprayError(
            f"spray.droplets: null, but {fuel.name} of spray.fuel_temperature_K: {hot_K:g} and "
            f"spray.injection_pressure_Pa: {pressure_Pa:g} is no gas with known properties; "
            f"allowed: {least_K:.1f} to {fuel.vapour.high_K:.0f} K"
        )


class GasJets:
    """Sources of all jets; it has what `parcels.Cloud` has, without a parcel.

    injected_kg: fuel that the gas has received.
    """

    born, wall_kg, station_sauter_m = 0, 0.0, float("nan")

    def __init__(
        self, spec: LagrangianSpray, injection: Injection, jet: Expansion, flow: GasFlow
    ) -> None:
        self.flow, self.injected_kg = flow, 0.0
        times, released = released_share(spec)
        self._released = times, released * spec.injected_mass_kg
        self._time_s, self._last_kg = 0.0, 0.0
        mass, push = _sources(flow.grid, spec, injection, jet)
        hot_K = np.array([spec.fuel_temperature_K])
        heat = float(flow.mixture.enthalpy_J_kg(np.ones(1), hot_K)[0])
        self._rate = np.concatenate([[mass, heat * mass], push])

    def step(self, step_s: float) -> bool:
        """Sets the sources of the gas, `flow.amounts`, for the next step."""
        self._time_s += step_s
        total = float(np.interp(self._time_s, *self._released))
        mass = total - self.injected_kg
        # A smaller change is rounding.
        if abs(mass - self._last_kg) > 1e-9 * self._last_kg:
            for plane, values in enumerate(self._rate):
                self.flow.write("amounts", mass * values, plane)
            self._last_kg = mass
        self.injected_kg += self._last_kg
        return True

    def give_birth(self, time_s: float) -> None:
        """Does nothing: there are no parcels."""

    def check(self) -> None:
        """Does nothing: there are no droplets."""

    def read(self) -> FlyingParcels:
        """No parcels."""
        none, vectors = np.empty(0), np.empty((0, 3))
        return FlyingParcels(none, none, none, vectors, vectors)

    def fastest_m_s(self) -> float:
        """Speed of the fastest gas; reads from the device."""
        return float(np.linalg.norm(self.flow.read("velocity"), axis=0).max())


def _sources(
    grid: RayGrid, spec: LagrangianSpray, injection: Injection, jet: Expansion
) -> tuple[Floats, Floats]:
    """Mass (A, P, R) and momentum in the grid's frame (3, A, P, R), per volume and kg of fuel.

    Between planes of symmetry one of the equal jets is made, and those on the axis, each of which
    has its share of the flow.
    """
    place = grid.directions[:, :, None] * grid.middle[2][:, None]
    nose_m = float(grid.radius_m[0])
    shares = np.array([plume.mass_fraction for plume in spec.plumes])
    shares /= shares.sum()
    aside = np.array([plume.inclination_deg > 0 for plume in spec.plumes])
    mass, push = np.zeros(grid.shape), np.zeros((3, *grid.shape))
    jets = zip(injection.axes, injection.jet_diameter_m, shares, strict=True)
    for number, (axis, diameter_m, share) in enumerate(jets):
        if grid.symmetry > 1 and aside[number]:
            if number != np.argmax(aside):
                continue
            share = shares[aside].sum()
        barrel_m = jet.disc * diameter_m / float(np.sqrt(jet.area))
        along = place @ axis
        beside2 = np.sum(place * place, axis=-1) - along * along
        # In a step of the gas a source expels less than its own gas.
        part = (along - nose_m) / max(barrel_m - nose_m, REACH_m)
        # The area of the profile of a source is the integral of exp(-x^2), sqrt(pi) / 2.
        width2 = np.maximum(part, 1e-3) * (diameter_m / 2) ** 2 / float(np.sqrt(np.pi) / 2)
        # Not less than a cell, of which there is one at least.
        width2 = width2 + 0.25 * grid.angle[:, :, None] * grid.middle[2] ** 2
        source = np.where((part > 0) & (part < 1), np.exp(-((beside2 / width2) ** 2)), 0.0)
        source *= share / (float(np.sum(source * grid.volume_m3)) * grid.copies)
        mass += source
        push += (jet.speed_m_s * grid.frame @ axis)[:, None, None, None] * source
    return mass, push
