"""Step of the parcels in the gas: their surroundings, their changes, and the gas's sources."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.spray.droplet.evaporation import Drop, Model, film, surface_vapour
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.integrator import DropletStates, DropletSurroundings, advance
from cldit.spray.flow.exchange import FACES, gather, scatter
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.gasjet import HALF_WIDTH, HANDED_OVER_CELLS, Jets
from cldit.spray.flow.injector import Injection

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE = 1e-2  # of a droplet's step; the gas is not more accurate


@dataclass(frozen=True)
class FlyingParcels:
    """Parcels in flight.

    mass_kg, temperature_K: of one droplet, (N,). droplets, hole: (N,). position_m, velocity_m_s:
    (N, 3).
    """

    mass_kg: Floats
    temperature_K: Floats
    droplets: Floats
    hole: Ints
    position_m: Floats
    velocity_m_s: Floats

    def where(self, chosen: NDArray[np.bool_]) -> FlyingParcels:
        """Parcels that are `chosen` (N,)."""
        names = self.__dataclass_fields__
        return FlyingParcels(**{name: getattr(self, name)[chosen] for name in names})

    def __add__(self, other: FlyingParcels) -> FlyingParcels:
        names = self.__dataclass_fields__
        both = {name: [getattr(self, name), getattr(other, name)] for name in names}
        return FlyingParcels(**{name: np.concatenate(pair) for name, pair in both.items()})

    @property
    def liquid_kg(self) -> Floats:
        """Liquid mass of each parcel (N,)."""
        return self.mass_kg * self.droplets


@dataclass(frozen=True)
class GasSources:
    """Sources of the gas in a step, per volume: mass, enthalpy (X, Y, Z); momentum (3, ...)."""

    mass: Floats
    enthalpy: Floats
    momentum: Floats


@dataclass(frozen=True)
class LiquidModel:
    """Constant data: fuel, carrier gas, evaporation model, and the injection."""

    fuel: Fuel
    carrier: Gas
    model: Model
    injection: Injection


def move(
    cloud: FlyingParcels,
    flow: GasFlow,
    jets: Jets,
    liquid: LiquidModel,
    *,
    time_s: float,
    step_s: float,
    random: np.random.Generator,
) -> tuple[FlyingParcels, GasSources]:
    """Parcels after a step, including those that vanished (mass 0), and the sources of the gas.

    The surroundings of the droplets are an estimate of the gas at the end of the step (`_seen`),
    because the gas changes faster than a step where there is much liquid. The sources are the
    difference of the liquid, so that all is conserved. Exchange is with the gas at the parcel, or
    where the jet of the parcel merges with the grid. `flow` is unchanged, `jets` is advanced, and
    `random` draws the eddies.
    """
    box = flow.box
    half = cloud.position_m + 0.5 * step_s * cloud.velocity_m_s
    jet = _jet(cloud, half, flow, jets, liquid.injection, time_s=time_s)
    there = half + (jet.weight * jet.ahead_m)[:, None] * jet.axis
    around = _seen(cloud, there, flow, liquid, jet, step_s=step_s)
    found = advance(
        DropletStates(cloud.mass_kg, cloud.temperature_K, cloud.velocity_m_s),
        around,
        step_s,
        fuel=liquid.fuel,
        gas=liquid.carrier,
        model=liquid.model,
        tolerance=TOLERANCE,
    )
    mass = cloud.droplets * found.mass_kg
    enthalpy = cloud.droplets * found.enthalpy_J - mass * flow.mixture.zero_J_kg
    momentum = cloud.droplets[:, None] * found.momentum_kg_m_s
    sources = GasSources(
        mass=scatter(box, there, mass),
        enthalpy=scatter(box, there, enthalpy),
        momentum=np.stack([scatter(box, there, momentum[:, a], FACES[a]) for a in range(3)]),
    )
    along = np.einsum("ij,ij->i", momentum, jet.axis)
    jets.push(cloud.hole, jet.along_m, along, step_s)
    # With the eddies at the end of the displacement: with those at its start, droplets would
    # accumulate in calm regions, which vapour does not.
    chance = np.sqrt(2 * step_s) * random.standard_normal(half.shape)
    trial = half + np.sqrt(gather(box, half, flow.eddy))[:, None] * chance
    position = cloud.position_m + found.path_m
    position = position + np.sqrt(gather(box, trial, flow.eddy))[:, None] * chance
    moved = replace(
        cloud,
        mass_kg=found.droplets.mass_kg,
        temperature_K=found.droplets.temperature_K,
        velocity_m_s=found.droplets.velocity_m_s,
        position_m=position,
    )
    return moved, sources


def _seen(
    cloud: FlyingParcels,
    at: Floats,
    flow: GasFlow,
    liquid: LiquidModel,
    jet: _JetAtParcels,
    *,
    step_s: float,
) -> DropletSurroundings:
    """Gas around each parcel at the end of the step, for linear rates (point-implicit).

    With the exchange coefficients k of the parcels, and their sum K over the cell and the step per
    mass of gas, the gas becomes (gas + K mean) / (1 + K), with the mean of the parcels by k.
    """
    box, count = flow.box, len(cloud.mass_kg)
    density = gather(box, at, flow.density)
    speed = np.stack([gather(box, at, flow.velocity[a], FACES[a]) for a in range(3)], axis=1)
    hot = gather(box, at, flow.temperature_K)
    share = np.clip(gather(box, at, flow.fuel) / density, 0.0, 1.0)
    pressure = np.full(count, flow.pressure_Pa)
    felt = jet.faster(speed)
    drop = Drop(
        fuel=liquid.fuel,
        gas=liquid.carrier,
        diameter_m=liquid.fuel.diameter_m(cloud.mass_kg, cloud.temperature_K),
        temperature_K=cloud.temperature_K,
        gas_temperature_K=hot,
        pressure_Pa=pressure,
        vapour=share,
        slip_m_s=np.linalg.norm(cloud.velocity_m_s - felt, axis=1),
    )
    state, surface = film(drop), surface_vapour(drop)
    size = cloud.droplets * np.pi * drop.diameter_m * step_s
    drag = 3 * size * state.viscosity_Pa_s * (1 + 0.15 * state.reynolds**0.687)
    drag = cloud.liquid_kg * -np.expm1(-drag / cloud.liquid_kg)  # at most all of it
    stir = 0.6 * np.sqrt(state.reynolds)
    number = np.where(np.abs(state.transfer) < 1e-9, 1e-9, state.transfer)
    mass = size * state.diffusion_kg_m_s * (2 + stir * np.cbrt(state.schmidt))
    mass = mass * np.log1p(number) / number / (1 - surface)
    heat = size * state.conductivity_W_m_K * (2 + stir * np.cbrt(state.prandtl))
    heat = heat / state.cp_J_kg_K

    def sums(weight: Floats, *values: Floats) -> tuple[Floats, list[Floats]]:
        """Coefficient K, and the means."""
        whole = gather(box, at, scatter(box, at, weight))
        safe = np.where(whole > 0, whole, 1.0)
        means = [gather(box, at, scatter(box, at, weight * each)) / safe for each in values]
        return whole / density, means

    k, mean = sums(drag, *cloud.velocity_m_s.T)
    speed = (speed + k[:, None] * np.stack(mean, axis=1)) / (1 + k[:, None])
    k, (mean_K,) = sums(heat, cloud.temperature_K)
    hot = (hot + k * mean_K) / (1 + k)
    k, (mean_share,) = sums(mass, surface)
    share = (share + k * mean_share) / (1 + k)
    felt = jet.faster(speed)
    return DropletSurroundings(hot, pressure, share, felt)


@dataclass(frozen=True)
class _JetAtParcels:
    """Gas jet around each parcel.

    axis: (N, 3). along_m, speed_m_s, weight: distance along it, its speed at the parcel, and its
    weight, (N,). ahead_m: distance to where it merges with the grid.
    """

    axis: Floats
    along_m: Floats
    speed_m_s: Floats
    weight: Floats
    ahead_m: Floats

    def faster(self, velocity_m_s: Floats) -> Floats:
        """Velocity of the gas (N, 3), with that of the jet along its axis if it is faster."""
        along = np.einsum("ij,ij->i", velocity_m_s, self.axis)
        lacking = self.weight * np.maximum(self.speed_m_s - along, 0.0)
        return np.asarray(velocity_m_s + lacking[:, None] * self.axis)


def _jet(
    cloud: FlyingParcels,
    at: Floats,
    flow: GasFlow,
    jets: Jets,
    injection: Injection,
    *,
    time_s: float,
) -> _JetAtParcels:
    axis = np.array([hole.axis for hole in injection.holes])[cloud.hole]
    along = np.einsum("ij,ij->i", at, axis)
    off = np.linalg.norm(at - along[:, None] * axis, axis=1)
    over = HANDED_OVER_CELLS * flow.box.spacing_m / HALF_WIDTH
    over = min(over, 0.5 * injection.speed_m_s * max(time_s - injection.start_s, 0.0))  # its head
    return _JetAtParcels(
        axis=axis,
        along_m=along,
        speed_m_s=jets.speed_m_s(cloud.hole, along, off),
        weight=jets.weight(along),
        ahead_m=np.maximum(over - along, 0.0),
    )
