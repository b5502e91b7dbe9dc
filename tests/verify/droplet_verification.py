"""Evaporation models at the conditions of published measurements; nothing is tuned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.follow import Life, follow
from cldit.spray.droplet.rates import Drop, rates
from tests.verify import droplet_published as published
from tests.verify.droplet_published import Suspended

_EVEN = (0.25, 0.8)  # of d0^2: where K is read off, in the measurements as in the models


def wet_bulb(kernels: DropletKernels, *, gas_K: float, pressure_Pa: float) -> Floats:
    """The state at rest in which no heat enters the liquid."""
    d, fuel = 10e-6, kernels.fuel
    drop = Drop(
        diameter_m=np.array([d]),
        temperature_K=np.array([gas_K]),
        gas_temperature_K=np.array([gas_K]),
        pressure_Pa=np.array([pressure_Pa]),
        vapour=np.zeros(1),
        slip_m_s=np.zeros(1),
    )
    low, high = fuel.liquid.low_K, min(gas_K, float(fuel.boiling_K(pressure_Pa)))
    for _ in range(50):  # down to rounding
        middle = 0.5 * (low + high)
        at = replace(drop, temperature_K=np.array([middle]))
        low, high = (middle, high) if rates(at, kernels).heat_W[0] > 0 else (low, middle)
    rate = rates(replace(drop, temperature_K=np.array([low])), kernels).mass_kg_s[0]
    density = float(fuel.liquid.value("density", low))
    return np.array([low, 1e6 * 4 * rate / (np.pi * density * d)])


def steady_K_mm2_s(life: Life) -> float:
    """Slope of d^2 over its even part."""
    square = (life.diameter_m / life.diameter_m[0]) ** 2
    part = (square >= _EVEN[0]) & (square <= _EVEN[1])
    slope = np.polyfit(life.time_s[part], life.diameter_m[part] ** 2 * 1e6, 1)[0]
    return float(-slope)


def microgravity_K_mm2_s(
    model: str,
    *,
    gas_temperature_K: float,
    pressure_Pa: float,
    diameter_m: float,
    device: Device,
    cache: Path,
) -> float:
    """Rate d(d^2)/dt [mm2/s] of n-heptane at 298 K, put into nitrogen at rest."""
    life = follow(
        fuel="n-heptane",
        diameter_m=diameter_m,
        temperature_K=published.NOMURA_LIQUID_K,
        gas_temperature_K=gas_temperature_K,
        pressure_Pa=pressure_Pa,
        model=model,
        points=41,
        device=device,
        cache=cache,
    )
    return steady_K_mm2_s(life)


def nomura_K_mm2_s(case: published.Microgravity) -> float:
    """Slope of the measured points."""
    return float(-np.polyfit(case.time_s_mm2, case.diameter2, 1)[0])


def suspended_mm2(case: Suspended, model: str, *, device: Device, cache: Path) -> Floats:
    """d^2 at the times of the measurement, in air at 101325 Pa."""
    life = follow(
        fuel="n-heptane",
        gas="air",
        diameter_m=case.diameter_m,
        temperature_K=case.temperature_K,
        gas_temperature_K=case.gas_temperature_K,
        pressure_Pa=101325.0,
        velocity_m_s=case.velocity_m_s,
        model=model,
        held=True,
        points=41,
        device=device,
        cache=cache,
    )
    return np.asarray(np.interp(case.time_s, life.time_s, life.diameter_m**2 * 1e6, right=0.0))
