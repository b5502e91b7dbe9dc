"""Mass loss of droplets, and heat into their liquid, on an OpenCL device."""

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


def rates(drop: Drop, kernels: DropletKernels) -> Rates:
    """Rates of droplets by the evaporation model of the kernels."""
    return Rates(*kernels.run("rates", drop.columns(), 2)[0])
