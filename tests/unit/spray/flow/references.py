"""The computed spray beside what is known of sprays: conditions, correlations, saturation."""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.scene.spray import EIGHT_PLUMES, Ambient, LagrangianSpray, Plume
from cldit.spray.cone.jet import NABER_SIEBERS, Jet
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.injector import inject
from cldit.spray.flow.measures import VAPOUR_SHARE, History, vapour_reach_m
from cldit.spray.flow.simulate import simulate_spray
from cldit.spray.result import Spray


@functools.cache
def fluids() -> tuple[Fuel, Gas]:
    """n-heptane and nitrogen, made at their first use."""
    return fuel_table("n-heptane", cache=None), gas_table("nitrogen", cache=None)


def saturation_Pa(fuel: Fuel, temperature_K: Any) -> Floats:
    return np.asarray(np.exp(fuel.liquid.value("ln_psat", temperature_K)))


def half_angle_rad(flow: GasFlow, axes: Floats) -> float:
    """Half angle of a cone as wide as the mean plume, at the edge of the vapour.

    It is measured from one to two thirds of the length along `axes` (H, 3); NaN without plumes.
    """
    grid = flow.grid
    middle = np.max(grid.directions @ axes.T, axis=2)[:, :, None] * grid.middle[2]
    tip = vapour_reach_m(flow, axes)
    within = (flow.read("share") >= VAPOUR_SHARE) & (middle > tip / 3) & (middle < 2 * tip / 3)
    if not within.any():
        return float("nan")
    # Volume of the cone's part: pi/3 tan^2 (b^3 - a^3).
    volume = float(grid.volume_m3[within].sum()) * grid.copies / len(axes)
    square = 3 * volume / np.pi / (tip**3 * (8 - 1) / 27)
    return float(np.arctan(np.sqrt(square)))


def with_cones(full_deg: float) -> tuple[Plume, ...]:
    """A scene's eight plumes with another cone."""
    return tuple(each.model_copy(update={"cone_angle_deg": full_deg}) for each in EIGHT_PLUMES)


CONDITIONS = (  # MPa, K
    (0.15, 300),
    (0.15, 620),
    (0.3, 500),
    (0.6, 300),
    (0.6, 400),
    (0.6, 573),
    (0.9, 300),
    (0.9, 620),
)
BASE = LagrangianSpray(injection_duration_s=0.78e-3)  # 10 mg, eight holes, at 0.95 ms
# ECN: iso-octane, 363 K, 20 MPa, into 573 K at 3.5 kg/m3. Plumes at 33 degrees with cones of 30, as
# Colmenares, Ameen and Patel describe this injector (J. Eng. Gas Turbines Power 145, 061009).
SPRAY_G = BASE.model_copy(
    update={
        "fuel": "iso-octane",
        "fuel_temperature_K": 363.0,
        "ambient": Ambient(pressure_Pa=0.6e6, temperature_K=573.0),
        "time_s": 1.2e-3,  # the liquid is farthest before
        "plumes": with_cones(30.0),
    }
)


@dataclass(frozen=True)
class Found:
    """A spray, how it came there, the processor time it took, and the jet of one of its plumes by
    Naber and Siebers, for the same flow, speed and cone. half_angle_rad: of the computed plumes.
    """

    spec: LagrangianSpray
    spray: Spray
    history: History
    seconds: float
    jet: Jet
    half_angle_rad: float

    @property
    def naber_siebers_m(self) -> float:
        """Since the start of injection, as if it had its full flow at once."""
        return self.jet.tip_m(self.spec.time_s)


def find(spec: LagrangianSpray, device: Device, *, cache: Path | None) -> Found:
    """Computes the spray `spec` and what it is compared with; tables are kept in `cache`."""
    fuel = fuel_table(spec.fuel, cache=cache)
    gas = gas_table(spec.gas, cache=cache)
    start = time.process_time()
    spray, history, flow = simulate_spray(spec, device, cache=cache)
    seconds = time.process_time() - start
    axes = inject(spec, fuel).axes
    return Found(
        spec=spec,
        spray=spray,
        history=history,
        seconds=seconds,
        jet=jet(spec, fuel, gas),
        half_angle_rad=half_angle_rad(flow, axes),
    )


def jet(spec: LagrangianSpray, fuel: Fuel, gas: Gas) -> Jet:
    """The jet of the first plume, by Naber and Siebers."""
    injection = inject(spec, fuel)
    diameter_m, ambient = float(injection.jet_diameter_m[0]), spec.ambient
    density = ambient.pressure_Pa * gas.molar_mass_kg_mol / (8.314462618 * ambient.temperature_K)
    return Jet(
        rate_kg_s=np.pi / 4 * diameter_m**2 * injection.density_kg_m3 * injection.speed_m_s,
        speed_m_s=injection.speed_m_s,
        half_angle_rad=float(np.radians(spec.plumes[0].cone_angle_deg / 2)),
        fuel_kg_m3=injection.density_kg_m3,
        gas_kg_m3=density,
        spreading=NABER_SIEBERS,
    )


def saturation(
    fuel: Fuel, gas: Gas, *, fuel_K: float, gas_K: float, pressure_Pa: float
) -> tuple[float, float]:
    """Adiabatic saturation: the gas mixed in just evaporates all of the fuel.

    No colder gas can hold all of it as vapour.
    """
    heavy = fuel.molar_mass_kg_mol / gas.molar_mass_kg_mol
    low = fuel.liquid.low_K
    high = min(gas_K, float(fuel.boiling_K(pressure_Pa)) * (1 - 1e-9))
    ratio = 0.0
    for _ in range(60):
        t = 0.5 * (low + high)
        mole = float(saturation_Pa(fuel, t)) / pressure_Pa
        ratio = heavy * mole / (1 - mole)
        taken = float(
            fuel.liquid.value("enthalpy", t)
            + fuel.liquid.value("latent", t)
            - fuel.liquid.value("enthalpy", fuel_K)
        )
        had = float(gas.vapour.value("enthalpy", gas_K) - gas.vapour.value("enthalpy", t))
        low, high = (t, high) if ratio * taken < had else (low, t)
    return low, ratio


def at(pressure_MPa: float, gas_K: float, **changes: Any) -> LagrangianSpray:
    """The base spray at another state of the gas."""
    ambient = Ambient(pressure_Pa=pressure_MPa * 1e6, temperature_K=float(gas_K))
    return BASE.model_copy(update={"ambient": ambient, **changes})


def alone(spec: LagrangianSpray) -> LagrangianSpray:
    """The first of the plumes by itself, straight down; the correlations are of such ones."""
    plume = spec.plumes[0].model_copy(update={"inclination_deg": 0.0})
    share = plume.mass_fraction / sum(each.mass_fraction for each in spec.plumes)
    return spec.model_copy(
        update={
            "plumes": (plume,),
            "injected_mass_kg": share * spec.injected_mass_kg,
        }
    )


def mean_liquid_K(spray: Spray) -> float:
    """Mean temperature of the liquid by mass; NaN without liquid."""
    if (parcels := spray.parcels) is None:
        return float("nan")
    mass = parcels.droplets * parcels.density_kg_m3 * parcels.diameter_m**3
    return float(np.sum(mass * parcels.temperature_K) / mass.sum())
