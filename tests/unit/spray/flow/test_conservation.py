"""A whole spray, droplets and gas: nothing is lost between them, whatever happens on the way."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from cldit.scene.spray import Ambient, LagrangianSpray
from cldit.spray.droplet.evaporation import MODELS
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table
from cldit.spray.flow.coupling import FlyingParcels, LiquidModel, move
from cldit.spray.flow.gas import FlowGrid, GasFlow
from cldit.spray.flow.gasjet import Jets
from cldit.spray.flow.injector import inject
from cldit.spray.flow.mixture import gas_mixture


@functools.cache
def fluids() -> tuple[Fuel, Gas]:
    return fuel_table("n-heptane", cache=None), gas_table("nitrogen", cache=None)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("name", ["abramzon-sirignano", "dukowicz"])
def test_mass_momentum_and_energy_of_a_spray_in_a_box(closed: bool, name: str) -> None:
    """2 mg at once into 700 K, within 0.3 ms: to 1e-12 of what there was in all, rounding of some
    1e7 additions. Energy is H - p V, for the box's volume is fixed. Momentum where there are no
    walls to take it up; the droplets' kinetic energy is left out."""
    fuel, carrier = fluids()
    spec = LagrangianSpray(
        injected_mass_kg=2e-6,
        droplets_per_parcel=1e4,
        ambient=Ambient(pressure_Pa=0.4e6, temperature_K=700.0),
    )
    injection = inject(spec, fuel)
    flow = GasFlow(
        FlowGrid(np.array([-15e-3, -15e-3, -26e-3]), 1.5e-3, (20, 20, 20), closed),
        gas_mixture(fuel, carrier, reference_K=700.0),
        pressure_Pa=0.4e6,
        temperature_K=700.0,
    )
    warm = np.full(len(injection.time_s), 370.0)
    cloud = FlyingParcels(
        mass_kg=fuel.mass_kg(injection.diameter_m, warm),
        temperature_K=warm,
        droplets=injection.droplets,
        hole=injection.hole,
        position_m=injection.position_m - [0.0, 0.0, 1e-3],
        velocity_m_s=injection.velocity_m_s * 0.4,  # none gets to a wall within the time
    )
    liquid = LiquidModel(fuel=fuel, carrier=carrier, model=MODELS[name], injection=injection)
    jets = Jets(
        len(injection.holes),
        speed_m_s=injection.speed_m_s,
        density_kg_m3=flow.far_density_kg_m3,
        spacing_m=flow.box.spacing_m,
    )
    random = np.random.default_rng(1)
    cell, volume = flow.box.cell_m3, flow.box.cell_m3 * float(np.prod(flow.box.shape))

    def totals() -> np.ndarray:
        heat = fuel.liquid.one("enthalpy", cloud.temperature_K) - flow.mixture.zero_J_kg
        energy = flow.enthalpy.sum() * cell - flow.pressure_Pa * volume
        mass = cloud.liquid_kg
        return np.array(
            [
                flow.density.sum() * cell + mass.sum(),
                flow.fuel.sum() * cell + mass.sum(),
                energy + np.sum(mass * heat),
                *(flow.flux.sum(axis=(1, 2, 3)) * cell + mass @ cloud.velocity_m_s),
            ]
        )

    before, first_kg = totals(), cloud.liquid_kg.sum()
    scale = np.array(
        [before[0], before[1], flow.pressure_Pa * volume, *[first_kg * injection.speed_m_s] * 3]
    )
    time = 0.0
    while time < 0.3e-3:
        step = min(5e-6, flow.longest_step_s())
        cloud, given = move(cloud, flow, jets, liquid, time_s=time, step_s=step, random=random)
        flow.step(step, mass=given.mass, enthalpy=given.enthalpy, momentum=given.momentum)
        cloud, time = cloud.where(cloud.mass_kg > 0), time + step
    assert 0.2 * first_kg < cloud.liquid_kg.sum() < 0.8 * first_kg  # much has happened
    assert flow.temperature_K.min() < 550.0
    assert np.abs(flow.velocity).max() > 10.0
    change = np.abs(totals() - before) / scale
    assert change[:3].max() < 1e-12
    if not closed:
        assert change[3:].max() < 1e-12
