"""Flow from the holes of a `cone` spray: speed, density, sizes, and mixtures with the gas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.fluid_properties import heptane_density_kg_m3
from cldit.spray.cone.mixing import Mixture, heptane_mixture
from cldit.spray.cone.wet_bulb import D2Law, WetBulb, d2_law, droplet_kernels, wet_bulb
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.follow import LARGEST_M
from cldit.spray.sizes import strata_m

VELOCITY_COEFFICIENT = 0.9  # speed at the hole over Bernoulli's
_CLASSES = 1024  # of the droplets' sizes


@dataclass(frozen=True)
class NozzleFlow:
    """Flow from the holes, the same for every plume except for the rate."""

    speed_m_s: float
    density_kg_m3: float
    flux_kg_m2_s: float
    mixture: Mixture
    sizes: D2Law | None = None
    bulb: WetBulb | None = None
    kernels: DropletKernels | None = None  # of droplets that evaporate


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
    if spec.injection_pressure_Pa <= ambient.pressure_Pa:
        raise SprayError(
            f"spray.injection_pressure_Pa: {spec.injection_pressure_Pa:g} is not above the "
            f"pressure of the gas, {ambient.pressure_Pa:g}"
        )
    density = float(heptane_density_kg_m3(spec.fuel_temperature_K))
    drop = spec.injection_pressure_Pa - ambient.pressure_Pa
    speed = VELOCITY_COEFFICIENT * float(np.sqrt(2 * drop / density))
    kernels = droplet_kernels(device) if spec.evaporation else None
    mixture = heptane_mixture(
        kernels,
        pressure_Pa=ambient.pressure_Pa,
        gas_K=ambient.temperature_K,
        fuel_K=spec.fuel_temperature_K,
    )
    classes = strata_m(spec.droplets, _CLASSES)
    if not classes[-1] <= LARGEST_M:
        raise SprayError(
            f"spray.droplets: these sizes reach {classes[-1]:.3g} m; allowed: up to "
            f"{LARGEST_M:g}, above which free drops of fuel break up"
        )
    bulb = None
    if kernels is not None:
        bulb = wet_bulb(
            kernels,
            gas_K=ambient.temperature_K,
            pressure_Pa=ambient.pressure_Pa,
            fuel_K=spec.fuel_temperature_K,
        )
    sizes = d2_law(classes, bulb)
    return NozzleFlow(speed, density, density * speed, mixture, sizes, bulb, kernels)
