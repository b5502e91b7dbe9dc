"""One step of the parcels in the gas: what they see, what becomes of them, what the gas gets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.spray.droplet.evaporation import Drop, Model, film, surface_vapour
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.integrator import Droplets, Surroundings, advance
from cldit.spray.flow.exchange import FACES, gather, scatter
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.gasjet import HALF_WIDTH, HANDED_OVER_CELLS, Jets
from cldit.spray.flow.injector import Injection

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE = 1e-2  # of a droplet's step: the gas is not known better


@dataclass(frozen=True)
class Cloud:
    """Parcels in flight: of one droplet mass_kg, temperature_K (N,); droplets, hole (N,);
    position_m, velocity_m_s (N, 3)."""

    mass_kg: Floats
    temperature_K: Floats
    droplets: Floats
    hole: Ints
    position_m: Floats
    velocity_m_s: Floats

    def where(self, chosen: NDArray[np.bool_]) -> Cloud:
        """The parcels that are `chosen` (N,)."""
        return Cloud(**{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})

    def __add__(self, other: Cloud) -> Cloud:
        names = self.__dataclass_fields__
        return Cloud(**{n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in names})

    @property
    def liquid_kg(self) -> Floats:
        """(N,) liquid mass of each parcel."""
        return self.mass_kg * self.droplets


@dataclass(frozen=True)
class Given:
    """What the gas gets in a step, per volume: mass, enthalpy (X, Y, Z); momentum (3, ...)."""

    mass: Floats
    enthalpy: Floats
    momentum: Floats


@dataclass(frozen=True)
class Liquid:
    """What does not change: fuel, carrier gas, evaporation model, and the injection."""

    fuel: Fuel
    carrier: Gas
    model: Model
    injection: Injection


def move(
    cloud: Cloud,
    flow: GasFlow,
    jets: Jets,
    liquid: Liquid,
    *,
    time_s: float,
    step_s: float,
    random: np.random.Generator,
) -> tuple[Cloud, Given]:
    """Parcels after a step, with those that vanished still in it (mass 0).

    The droplets' surroundings are an estimate of the gas at the end of the step (`_seen`): where
    there is much liquid, the gas changes faster than steps of the flow are long. What the gas gets
    is the difference between the liquid before and after, so nothing is lost. Exchange is with the
    gas where the parcel is, or where the jet that it is in hands over to the grid. `jets` moves on,
    too.

    Args:
        cloud: parcels before the step.
        flow: the gas, which is not changed.
        jets: the unresolved jets, which move on.
        liquid: fuel, gas and model.
        time_s, step_s: present time, and length of the step.
        random: draws the eddies.

    Returns:
        The parcels after the step, and what the gas gets.
    """
    box = flow.box
    half = cloud.position_m + 0.5 * step_s * cloud.velocity_m_s
    jet = _jet(cloud, half, flow, jets, liquid.injection, time_s=time_s)
    there = half + (jet.weight * jet.ahead_m)[:, None] * jet.axis
    around = _seen(cloud, there, flow, liquid, jet, step_s=step_s)
    found = advance(
        Droplets(cloud.mass_kg, cloud.temperature_K, cloud.velocity_m_s),
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
    given = Given(
        mass=scatter(box, there, mass),
        enthalpy=scatter(box, there, enthalpy),
        momentum=np.stack([scatter(box, there, momentum[:, a], FACES[a]) for a in range(3)]),
    )
    along = np.einsum("ij,ij->i", momentum, jet.axis)
    jets.push(cloud.hole, jet.along_m, along, step_s)
    # By the eddies where such a step leads: by those where it starts droplets would gather where
    # it is calm, which eddies do not do to vapour either.
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
    return moved, given


def _seen(
    cloud: Cloud, at: Floats, flow: GasFlow, liquid: Liquid, jet: _Jet, *, step_s: float
) -> Surroundings:
    """Gas around each parcel at the end of the step, were all rates linear (point-implicit).

    With exchange coefficients k of the parcels, summed over the cell and the step per gas, K, the
    gas becomes (gas + K mean) / (1 + K), where the mean is that of the parcels weighted with k.
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
    drag = cloud.liquid_kg * -np.expm1(-drag / cloud.liquid_kg)  # no more than all it has
    stir = 0.6 * np.sqrt(state.reynolds)
    number = np.where(np.abs(state.transfer) < 1e-9, 1e-9, state.transfer)
    mass = size * state.diffusion_kg_m_s * (2 + stir * np.cbrt(state.schmidt))
    mass = mass * np.log1p(number) / number / (1 - surface)
    heat = size * state.conductivity_W_m_K * (2 + stir * np.cbrt(state.prandtl))
    heat = heat / state.cp_J_kg_K

    def sums(weight: Floats, *values: Floats) -> tuple[Floats, list[Floats]]:
        """K, and the means."""
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
    return Surroundings(hot, pressure, share, felt)


@dataclass(frozen=True)
class _Jet:
    """The gas jet that parcels are in: its axis (N, 3), the distance along it, speed at each and
    how much of it counts, (N,), and the way to where it hands over to the grid."""

    axis: Floats
    along_m: Floats
    speed_m_s: Floats
    weight: Floats
    ahead_m: Floats

    def faster(self, velocity_m_s: Floats) -> Floats:
        """Velocity of the gas (N, 3): the jet's along its axis, if that is faster."""
        along = np.einsum("ij,ij->i", velocity_m_s, self.axis)
        lacking = self.weight * np.maximum(self.speed_m_s - along, 0.0)
        return np.asarray(velocity_m_s + lacking[:, None] * self.axis)


def _jet(
    cloud: Cloud, at: Floats, flow: GasFlow, jets: Jets, injection: Injection, *, time_s: float
) -> _Jet:
    axis = np.array([hole.axis for hole in injection.holes])[cloud.hole]
    along = np.einsum("ij,ij->i", at, axis)
    off = np.linalg.norm(at - along[:, None] * axis, axis=1)
    over = HANDED_OVER_CELLS * flow.box.spacing_m / HALF_WIDTH
    over = min(over, 0.5 * injection.speed_m_s * max(time_s - injection.start_s, 0.0))  # its head
    return _Jet(
        axis=axis,
        along_m=along,
        speed_m_s=jets.speed_m_s(cloud.hole, along, off),
        weight=jets.weight(along),
        ahead_m=np.maximum(over - along, 0.0),
    )
