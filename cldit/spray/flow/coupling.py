"""Step of the parcels in the gas: their surroundings, their changes, and the gas's sources."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.spray.droplet.evaporation import Drop, Model, film, surface_vapour
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.integrator import DropletStates, DropletSurroundings, advance
from cldit.spray.flow.exchange import Places, folded, gather, places, scatter, unfolded
from cldit.spray.flow.gas import GasFlow

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE = 1e-2  # of a droplet's step; the gas is not more accurate


@dataclass(frozen=True)
class FlyingParcels:
    """Parcels in flight.

    mass_kg, temperature_K: of one droplet, (N,). droplets, hole: (N,). number: (N,), in the order
    of injection. position_m, velocity_m_s: (N, 3).
    """

    mass_kg: Floats
    temperature_K: Floats
    droplets: Floats
    hole: Ints
    number: Ints
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
    """Sources of the gas in a step, per volume: mass, enthalpy; momentum (3, ...)."""

    mass: Floats
    enthalpy: Floats
    momentum: Floats


@dataclass(frozen=True)
class LiquidModel:
    """Constant data: fuel, carrier gas and evaporation model."""

    fuel: Fuel
    carrier: Gas
    model: Model


def move(
    cloud: FlyingParcels,
    flow: GasFlow,
    liquid: LiquidModel,
    *,
    step_s: float,
    random: np.random.Generator,
) -> tuple[FlyingParcels, GasSources]:
    """Parcels after a step, including those that vanished (mass 0), and the sources of the gas.

    The surroundings of the droplets are an estimate of the gas at the end of the step (`_seen`),
    because the gas changes faster than a step where there is much liquid. The sources are the
    difference of the liquid, so that all is conserved. Exchange is with the gas half a step ahead.
    `flow` is unchanged. `random` draws the eddies, for a parcel by its number: sprays of equal
    steps, on any grid, have the same.
    """
    grid = flow.grid
    half = cloud.position_m + 0.5 * step_s * cloud.velocity_m_s
    at = places(grid, half)
    found = advance(
        DropletStates(cloud.mass_kg, cloud.temperature_K, cloud.velocity_m_s),
        _seen(cloud, at, flow, liquid, step_s=step_s),
        step_s,
        fuel=liquid.fuel,
        gas=liquid.carrier,
        model=liquid.model,
        tolerance=TOLERANCE,
    )
    mass = cloud.droplets * found.mass_kg
    enthalpy = cloud.droplets * found.enthalpy_J - mass * flow.mixture.zero_J_kg
    momentum = folded(grid, at, cloud.droplets[:, None] * found.momentum_kg_m_s)
    given = scatter(grid, at, mass, enthalpy, *momentum.T)
    sources = GasSources(mass=given[0], enthalpy=given[1], momentum=given[2:])
    # With the eddies at the end of the displacement: with those at its start, droplets would
    # accumulate in calm regions, which vapour does not.
    drawn = random.standard_normal((int(cloud.number.max(initial=-1)) + 1, 3))
    chance = np.sqrt(2 * step_s) * drawn[cloud.number]
    trial = places(grid, half + np.sqrt(gather(at, flow.eddy))[:, None] * chance)
    position = cloud.position_m + found.path_m
    position = position + np.sqrt(gather(trial, flow.eddy))[:, None] * chance
    moved = replace(
        cloud,
        mass_kg=found.droplets.mass_kg,
        temperature_K=found.droplets.temperature_K,
        velocity_m_s=found.droplets.velocity_m_s,
        position_m=position,
    )
    return moved, sources


def _seen(
    cloud: FlyingParcels, at: Places, flow: GasFlow, liquid: LiquidModel, *, step_s: float
) -> DropletSurroundings:
    """Gas around each parcel at the end of the step, for linear rates (point-implicit).

    With the exchange coefficients k of the parcels, and their sum K over the cell and the step per
    mass of gas, the gas becomes (gas + K mean) / (1 + K), with the mean of the parcels by k.
    """
    grid, count = flow.grid, len(cloud.mass_kg)
    density = gather(at, flow.density)
    speed = np.stack([gather(at, each) for each in flow.velocity], axis=1)
    hot = gather(at, flow.temperature_K)
    share = np.clip(gather(at, flow.fuel) / density, 0.0, 1.0)
    pressure = np.full(count, flow.pressure_Pa)
    own = folded(grid, at, cloud.velocity_m_s)
    drop = Drop(
        fuel=liquid.fuel,
        gas=liquid.carrier,
        diameter_m=liquid.fuel.diameter_m(cloud.mass_kg, cloud.temperature_K),
        temperature_K=cloud.temperature_K,
        gas_temperature_K=hot,
        pressure_Pa=pressure,
        vapour=share,
        slip_m_s=np.linalg.norm(own - speed, axis=1),
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
        fields = scatter(grid, at, weight, *(weight * each for each in values))
        whole, *parts = (gather(at, each) for each in fields)
        safe = np.where(whole > 0, whole, 1.0)
        return whole / density, [each / safe for each in parts]

    k, mean = sums(drag, *own.T)
    speed = (speed + k[:, None] * np.stack(mean, axis=1)) / (1 + k[:, None])
    k, (mean_K,) = sums(heat, cloud.temperature_K)
    hot = (hot + k * mean_K) / (1 + k)
    k, (mean_share,) = sums(mass, surface)
    share = (share + k * mean_share) / (1 + k)
    return DropletSurroundings(hot, pressure, share, unfolded(grid, at, speed))
