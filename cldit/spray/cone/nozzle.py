"""Flow from the holes of a `cone` spray: speed, density, sizes, and mixtures with the gas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.scene.spray import ConeSpray, LagrangianSpray, Plume
from cldit.spray.cone.fluid_properties import heptane_density_kg_m3
from cldit.spray.cone.mixing import Mixture, heptane_mixture
from cldit.spray.cone.wet_bulb import D2Law, d2_law, droplet_kernels, wet_bulb
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.sizes import FREE_DROP_M, strata_m

VELOCITY_COEFFICIENT = 0.9  # speed at the hole over Bernoulli's
_CLASSES = 1024  # of the droplets' sizes


def plume_axis(plume: Plume) -> Floats:
    """Direction of a plume, a unit vector."""
    inclination, azimuth = np.radians(plume.inclination_deg), np.radians(plume.azimuth_deg)
    side = np.sin(inclination)
    return np.array([side * np.cos(azimuth), side * np.sin(azimuth), -np.cos(inclination)])


def pressure_drop_Pa(spec: ConeSpray | LagrangianSpray) -> float:
    """Pressure that drives the injection; raises SprayError if there is none."""
    drop = spec.injection_pressure_Pa - spec.ambient.pressure_Pa
    if drop <= 0:
        raise SprayError(
            f"spray.injection_pressure_Pa: {spec.injection_pressure_Pa:g} is not above the "
            f"pressure of the gas, {spec.ambient.pressure_Pa:g}"
        )
    return drop


def liquid_speed_m_s(spec: ConeSpray | LagrangianSpray, density_kg_m3: float) -> float:
    """Speed of liquid at the holes; raises as `pressure_drop_Pa`."""
    return VELOCITY_COEFFICIENT * float(np.sqrt(2 * pressure_drop_Pa(spec) / density_kg_m3))


def flow_coefficient(
    spec: ConeSpray | LagrangianSpray, *, rate_kg_s: float, flux_kg_m2_s: float
) -> float:
    """Ratio of a flow to that of a flux in all holes; raises SprayError if it is above 1."""
    holes = len(spec.plumes) * np.pi / 4 * spec.hole_diameter_m**2
    coefficient = rate_kg_s / (holes * flux_kg_m2_s)
    if coefficient > 1:
        raise SprayError(
            f"spray.injected_mass_kg: {spec.injected_mass_kg:g} is {coefficient:.3g} times what "
            f"the pressure drives through {len(spec.plumes)} holes of "
            f"{spec.hole_diameter_m:g} m; at most {spec.injected_mass_kg / coefficient:.3g}"
        )
    return float(coefficient)


def check_free_drops(largest_m: float) -> None:
    """Raises SprayError if the largest droplet would break up."""
    if not largest_m <= FREE_DROP_M:
        raise SprayError(
            f"spray.droplets: these sizes reach {largest_m:.3g} m; allowed: up to "
            f"{FREE_DROP_M:g}, above which free drops of fuel break up"
        )


@dataclass(frozen=True)
class NozzleFlow:
    """Flow from the holes, the same for every plume except for the rate.

    kernels: of droplets that evaporate, whose wet bulb and K of the d^2 law in the undisturbed gas
    are wet_bulb_K and rate_m2_s; NaN without evaporation.
    """

    speed_m_s: float
    density_kg_m3: float
    flux_kg_m2_s: float
    mixture: Mixture
    sizes: D2Law
    kernels: DropletKernels | None
    wet_bulb_K: float
    rate_m2_s: float


def nozzle_flow(spec: ConeSpray, device: Device) -> NozzleFlow:
    """State of the fuel at the holes, and the table of its mixtures with the gas.

    Cones that differ only in lattice and size classes share it. Raises SprayError if the pressure
    does not drive a flow, or if droplets are missing.
    """
    return _nozzle_flow(without_lattice(spec), device)


def without_lattice(spec: ConeSpray) -> ConeSpray:
    """The cone without its lattice and size classes."""
    return spec.model_copy(update={"spacing_m": None, "size_classes": None})


@lru_cache(maxsize=4)
def _nozzle_flow(spec: ConeSpray, device: Device) -> NozzleFlow:
    ambient = spec.ambient
    density = float(heptane_density_kg_m3(spec.fuel_temperature_K))
    speed = liquid_speed_m_s(spec, density)
    kernels = droplet_kernels(device) if spec.evaporation else None
    mixture = heptane_mixture(
        kernels,
        pressure_Pa=ambient.pressure_Pa,
        gas_K=ambient.temperature_K,
        fuel_K=spec.fuel_temperature_K,
    )
    classes = strata_m(spec.droplets, _CLASSES)
    check_free_drops(classes[-1])
    bulb_K, rate, start = np.nan, np.nan, None
    if kernels is not None:
        bulb_K, rate, start = wet_bulb(
            kernels,
            gas_K=ambient.temperature_K,
            pressure_Pa=ambient.pressure_Pa,
            fuel_K=spec.fuel_temperature_K,
        )
    sizes = d2_law(classes, start)
    return NozzleFlow(speed, density, density * speed, mixture, sizes, kernels, bulb_K, rate)
