"""Mass loss of droplets, heat into their liquid, and the film around them, on an OpenCL device."""

from __future__ import annotations

from dataclasses import dataclass

from cldit.arrays import Floats
from cldit.spray.droplet.arrays import DropletKernels


@dataclass(frozen=True)
class Drop:
    """Droplets and the gas far from each; all (N,).

    temperature_K: of the liquid, uniform. vapour: mass fraction of fuel in the gas.
    slip_m_s: speed relative to the gas.
    """

    diameter_m: Floats
    temperature_K: Floats
    gas_temperature_K: Floats
    pressure_Pa: Floats
    vapour: Floats
    slip_m_s: Floats

    def columns(self) -> dict[str, list[Floats]]:
        """Arguments of the kernels."""
        return {
            "drops": [self.diameter_m, self.temperature_K, self.slip_m_s],
            "gas": [self.gas_temperature_K, self.pressure_Pa, self.vapour],
        }


@dataclass(frozen=True)
class Rates:
    """Rates, all (N,). mass_kg_s: evaporation, < 0 in condensation. heat_W: into the liquid."""

    mass_kg_s: Floats
    heat_W: Floats


@dataclass(frozen=True)
class Film:
    """Gas around a droplet at its reference state; all (N,).

    transfer: mass transfer number BM. surface: mass fraction of fuel at the surface (Raoult's law,
    limited at boiling). density_kg_m3: far from the droplet. cp_vapour_J_kg_K: of the fuel's
    vapour. diffusion_kg_m_s: density times diffusivity.
    """

    transfer: Floats
    surface: Floats
    density_kg_m3: Floats
    viscosity_Pa_s: Floats
    reynolds: Floats
    prandtl: Floats
    schmidt: Floats
    cp_J_kg_K: Floats
    cp_vapour_J_kg_K: Floats
    conductivity_W_m_K: Floats
    diffusion_kg_m_s: Floats


def rates(drop: Drop, kernels: DropletKernels) -> Rates:
    """Rates of droplets by the evaporation model of the kernels."""
    return Rates(*kernels.run("rates", drop.columns(), 2)[0])


def film(drop: Drop, kernels: DropletKernels, *, share: float = 1 / 3) -> Film:
    """Film at a `share` of the way from surface to gas, see kernels/spray/droplet_film.h."""
    return Film(*kernels.run("films", drop.columns(), 11, share=share)[0])
