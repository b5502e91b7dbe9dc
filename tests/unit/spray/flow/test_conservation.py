"""Mass, energy and momentum of a whole spray, droplets and gas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.scene.spray import EIGHT_PLUMES, Ambient, FlowBox, LagrangianSpray, Plume
from cldit.spray.droplet.fluids import property_table
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.injector import inject
from cldit.spray.flow.mixture import gas_mixture
from cldit.spray.flow.parcels import Cloud
from cldit.spray.flow.ray_choice import ray_grid
from tests.kernels.droplet_twin import Properties
from tests.unit.spray.flow.references import fluids

ULP = float(np.finfo(np.float32).eps)
STEPS, STEP_S = 40, 5e-6
KINDS = {
    "round": (Plume(inclination_deg=33.0, azimuth_deg=20.0),),
    "equal": EIGHT_PLUMES,
    "any": tuple(
        Plume(inclination_deg=lean, azimuth_deg=turn, mass_fraction=share)
        for lean, turn, share in ((20.0, 10.0, 1.0), (35.0, 100.0, 1.5), (28.0, 250.0, 1.0))
    ),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name", ["abramzon-sirignano", pytest.param("dukowicz", marks=pytest.mark.slow)]
)
def test_mass_momentum_and_energy_of_a_spray(device: Device, kind: str, name: str) -> None:
    """All parcels at once into 700 K, within 0.2 ms.

    Energy is H - p V, for the volume is fixed; momentum is with that of the walls; kinetic energy
    of the droplets is neglected. Parcels are in single precision: what a step takes from one is
    rounded by an ULP of all that it has. Thus the errors are at most an ULP times the steps times
    the fuel's mass, momentum, and enthalpy (30 ULP of which, by the sums of the property's fit).
    """
    fuel, carrier = fluids()
    spec = LagrangianSpray(
        injected_mass_kg=0.4e-6 * (3 if kind == "equal" else 1),
        droplets_per_parcel=2e3,
        ambient=Ambient(pressure_Pa=0.4e6, temperature_K=700.0),
        box=FlowBox(spacing_m=4e-3),
        plumes=KINDS[kind],
        evaporation=name,
    )
    injection = inject(spec, fuel)
    count = len(injection.time_s)
    random = np.random.default_rng(1)
    ahead = random.uniform(1e-3, 8e-3, count)[:, None] / injection.speed_m_s
    injection = replace(
        injection,
        time_s=np.zeros(count),
        position_m=injection.position_m + ahead * injection.velocity_m_s,
        velocity_m_s=injection.velocity_m_s * 0.4,  # none gets to a wall within the time
    )
    flow = GasFlow(
        ray_grid(spec, injection, gas_kg_mol=0.0280134),
        gas_mixture(fuel, carrier, reference_K=700.0),
        pressure_Pa=0.4e6,
        temperature_K=700.0,
        device=device,
        real=np.float64 if device.info.float64 else np.float32,
    )
    cloud = Cloud(spec, injection, flow, fuel=fuel, carrier=carrier)
    cloud.give_birth(1e-12)
    grid, volume, known = flow.grid, flow.grid.volume_m3, Properties(property_table(fuel, carrier))
    pushed = np.zeros(3)

    def totals() -> Floats:
        liquid, density = cloud.read(), flow.read("density")
        mass = liquid.liquid_kg
        heat = known.liquid(liquid.temperature_K)[5] - flow.mixture.zero_J_kg
        energy = np.sum((flow.read("enthalpy") - flow.pressure_Pa) * volume) * grid.copies
        moved = np.sum(flow.read("velocity") * density * volume, axis=(1, 2, 3)) - pushed
        own = mass @ liquid.velocity_m_s
        # In the sectors of equal plumes only what is along the axis adds up.
        return np.array(
            [
                np.sum(density * volume) * grid.copies + mass.sum(),
                flow.fuel_kg + mass.sum(),
                energy + np.sum(mass * heat),
                *(moved * grid.copies + grid.frame @ own),
            ]
        )

    before, start = totals(), cloud.read()
    first_kg = start.liquid_kg.sum()
    for _ in range(STEPS):
        cloud.step(STEP_S)
        flow.step(STEP_S)
        pushed += np.sum(flow.read("force"), axis=(1, 2, 3))
    flow.check()
    cloud.check()
    end = cloud.read()
    assert 0.1 * first_kg < end.liquid_kg.sum() < 0.8 * first_kg  # much has happened
    assert cloud.wall_kg == 0.0
    assert flow.read("temperature").min() < 600.0
    assert np.abs(flow.read("velocity")).max() > 10.0
    eps = float(np.finfo(flow.fields.real).eps)
    gas_kg, whole_J = before[0], flow.pressure_Pa * volume.sum() * grid.copies
    speed = float(np.linalg.norm(start.velocity_m_s, axis=1).max())
    latent = np.abs(known.liquid(np.array([300.0, 400.0]))[5] - flow.mixture.zero_J_kg).max()
    rounded = STEPS * ULP * first_kg
    gas = 40 * STEPS * eps
    allowed = np.array(
        [
            rounded + gas * gas_kg,
            rounded + gas * first_kg,
            30 * rounded * latent + gas * whole_J,
            *[rounded * speed + gas * gas_kg * speed] * 3,
        ]
    )
    change = np.abs(totals() - before)
    assert np.all(change[:3] < allowed[:3])
    kept = slice(3, 6) if grid.symmetry == 1 else slice(5, 6)
    assert np.all(change[kept] < allowed[kept])
    # The bounds are small against what was exchanged.
    assert np.all(allowed[[1, 2]] < 1e-2 * np.array([first_kg, first_kg * latent]))
