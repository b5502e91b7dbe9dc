"""Evaporation of n-heptane droplets at rest, for the `cone` spray: wet bulb and d^2 law.

The film is that of `cldit.spray.droplet` (Spalding's, which is Abramzon and Sirignano's at rest),
with the property fits of the cone's mixtures (`fluid_properties.py`), so that a droplet in
saturated gas is in equilibrium. The d^2 law gives the sizes that remain with an evaporated share.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.constants import HEPTANE_MOLAR_MASS_kg_mol
from cldit.gpu.device import Device
from cldit.spray.cone.fluid_properties import (
    HEPTANE_CRITICAL_K,
    HEPTANE_DIFFUSION_VOLUME,
    HEPTANE_LIQUID_MAX_K,
    NITROGEN_DIFFUSION_VOLUME,
    HEPTANE_CRITICAL_Pa,
    NITROGEN_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
    heptane_latent_heat_J_kg,
    heptane_liquid_conductivity_W_m_K,
    heptane_liquid_cp_J_kg_K,
    heptane_liquid_enthalpy_J_kg,
    heptane_saturation_pressure_Pa,
    heptane_vapour_conductivity_W_m_K,
    heptane_vapour_cp_J_kg_K,
    heptane_vapour_viscosity_Pa_s,
    nitrogen_conductivity_W_m_K,
    nitrogen_cp_J_kg_K,
    nitrogen_viscosity_Pa_s,
)
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.curves import curves
from cldit.spray.droplet.fluids import Fuel, Gas
from cldit.spray.droplet.models import MODELS
from cldit.spray.droplet.rates import Drop, Rates, rates

_SIZE_m = 10e-6  # arbitrary: both rates are proportional to it at rest
_POINTS = 400  # of a zoom; and of a midpoint rule, of error 1/(24 400^2) = 3e-7 of the curvature
_STEPS = 500  # of the d^2 law


@functools.cache
def fluids() -> tuple[Fuel, Gas]:
    """Tables of the fits, for the evaporation models."""
    cold = np.linspace(180.0, HEPTANE_LIQUID_MAX_K, 711)
    gas = np.linspace(150.0, 2500.0, 2351)
    liquid = {
        "ln_psat": np.log(heptane_saturation_pressure_Pa(cold)),
        "density": heptane_density_kg_m3(cold),
        "cp": heptane_liquid_cp_J_kg_K(cold),
        "enthalpy": heptane_liquid_enthalpy_J_kg(cold),
        "latent": heptane_latent_heat_J_kg(cold),
        "conductivity": heptane_liquid_conductivity_W_m_K(cold),
    }
    fuel = Fuel(
        name="n-heptane",
        molar_mass_kg_mol=HEPTANE_MOLAR_MASS_kg_mol,
        diffusion_volume=HEPTANE_DIFFUSION_VOLUME,
        critical_K=HEPTANE_CRITICAL_K,
        critical_Pa=HEPTANE_CRITICAL_Pa,
        vapour=curves(
            gas,
            {
                "cp": heptane_vapour_cp_J_kg_K(gas),
                "conductivity": heptane_vapour_conductivity_W_m_K(gas),
                "viscosity": heptane_vapour_viscosity_Pa_s(gas),
            },
        ),
        liquid=curves(cold, liquid),
    )
    carrier = Gas(
        name="nitrogen",
        molar_mass_kg_mol=NITROGEN_MOLAR_MASS_kg_mol,
        diffusion_volume=NITROGEN_DIFFUSION_VOLUME,
        critical_K=126.2,
        critical_Pa=3.396e6,
        vapour=curves(
            gas,
            {
                "cp": nitrogen_cp_J_kg_K(gas),
                "conductivity": nitrogen_conductivity_W_m_K(gas),
                "viscosity": nitrogen_viscosity_Pa_s(gas),
            },
        ),
    )
    return fuel, carrier


def droplet_kernels(device: Device) -> DropletKernels:
    """Kernels for the cone's droplets; in float on a device without double precision."""
    real = np.float64 if device.info.float64 else np.float32
    return DropletKernels.of(device, *fluids(), MODELS["abramzon-sirignano"], real=real)


def at_rest(
    surface_K: ArrayLike,
    kernels: DropletKernels,
    *,
    gas_K: ArrayLike,
    vapour_share: ArrayLike,
    pressure_Pa: float,
) -> Rates:
    """Rates of droplets of 10 um at rest, any shape; heat into the liquid is 0 at the wet bulb.

    `vapour_share` is the mass fraction of fuel in the gas.
    """
    columns = np.broadcast_arrays(_SIZE_m, surface_K, gas_K, pressure_Pa, vapour_share, 0.0)
    shape = columns[0].shape
    droplets = rates(Drop(*(np.ravel(column).astype(float) for column in columns)), kernels)
    return Rates(droplets.mass_kg_s.reshape(shape), droplets.heat_W.reshape(shape))


def wet_bulb(
    kernels: DropletKernels, *, gas_K: float, pressure_Pa: float, fuel_K: float
) -> tuple[float, float, float]:
    """Wet bulb in K in gas without fuel, below its critical pressure, and the d^2 law there.

    The law is d^2 / d0^2 = s0 - K t / d0^2: rate K in m2/s, and start s0, which is above 1 if a
    droplet is heated to the wet bulb (it does not shrink while the sum is above 1), and below 1 if
    it is warmer and its own heat evaporates a share (immediately). With Q the heat into the liquid,
    dm/m = cp dT mdot/Q during the approach to the wet bulb. The difference from the steady rate in
    the same time goes into s0. `fuel_K` is the initial temperature of the fuel.
    """

    def at(surface_K: ArrayLike) -> Rates:
        return at_rest(surface_K, kernels, gas_K=gas_K, vapour_share=0.0, pressure_Pa=pressure_Pa)

    low, high = 0.4 * gas_K, max(gas_K, HEPTANE_CRITICAL_K)
    # Five zooms by 400 each: 1e13, down to rounding.
    for _ in range(5):
        surface = np.linspace(low, high, _POINTS + 1)
        index = int(np.clip(np.count_nonzero(at(surface).heat_W > 0), 1, _POINTS))
        low, high = surface[index - 1 : index + 1]
    steady = float(at(low).mass_kg_s)
    rate = 4 * steady / (np.pi * _SIZE_m * float(heptane_density_kg_m3(low)))
    way = fuel_K + (low - fuel_K) * (np.arange(_POINTS) + 0.5) / _POINTS
    approach = at(way)
    slope = heptane_liquid_cp_J_kg_K(way) * (steady - approach.mass_kg_s) / approach.heat_W
    change = float(np.mean(slope)) * (low - fuel_K)
    return float(low), rate, float(np.exp(2 / 3 * change))


@dataclass(frozen=True)
class D2Law:
    """States of a size distribution during evaporation, by the d^2 law of every size class.

    loss_m2: K t, the decrease of d^2, (N,); evaporated: share of the mass, rising from 0 to 1,
    (N,). mass, surface: cumulative sums over the classes, by rising size, of the remaining mass and
    of that mass over its diameter (1/m), at the initial density of the liquid, (N, classes + 1).
    """

    loss_m2: Floats
    evaporated: Floats
    mass: Floats
    surface: Floats

    def diameters_m(self, evaporated: ArrayLike, count: int) -> Floats:
        """Rising diameters (N, count) of equal shares of the remaining mass.

        `evaporated` (N,) is the evaporated share, 0..1. Each diameter has the surface per mass of
        its share, as in `strata_m`, so that D32 is conserved.
        """
        edges = np.linspace(0.0, 1.0, count + 1)
        rows = len(self.evaporated) - 1  # nothing remains in the last
        table = np.empty((rows, count))
        for row in range(rows):
            bounds = np.interp(edges * self.mass[row, -1], self.mass[row], self.surface[row])
            table[row] = self.mass[row, -1] / count / np.diff(bounds)
        state = np.searchsorted(self.evaporated, np.asarray(evaporated, dtype=float))
        return np.asarray(table[np.minimum(state, rows - 1)])


def d2_law(classes_m: Floats, start: float | None) -> D2Law:
    """Evaporation of droplets of rising diameters (C,), each an equal share of the mass.

    `start` is that of `wet_bulb`. Without it nothing evaporates, and the two states are the initial
    and the final one.
    """
    squares = classes_m**2
    if start is None:
        begin, loss = np.ones(2), np.array([0.0, squares[-1]])
    else:
        # Warm liquid first loses the same share of every droplet, then follows the d^2 law.
        at_once = np.linspace(1.0, start, 40)[:-1] if start < 1 else np.empty(0)
        later = start * squares[-1] * np.linspace(0.0, 1.0, _STEPS) ** 2
        begin = np.append(at_once, np.full(_STEPS, start))
        loss = np.append(np.zeros(len(at_once)), later)
    remaining = np.clip(begin[:, None] - loss[:, None] / squares, 0.0, 1.0)
    mass = remaining**1.5
    total = mass.sum(axis=1)
    # A vanished class adds nothing to either sum.
    diameter = classes_m * np.sqrt(remaining)
    over = np.divide(mass, diameter, out=np.zeros_like(mass), where=remaining > 0)
    sums = [np.pad(np.cumsum(amount, axis=1), ((0, 0), (1, 0))) for amount in (mass, over)]
    return D2Law(loss, 1 - total / len(squares), sums[0], sums[1])
