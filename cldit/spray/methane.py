"""Under-expanded methane: flow through the choked hole, and the jet once it has expanded.

Ideal gas of variable heat capacity, no losses. The shock cells (Mach discs) right below the hole
are not modelled: the jet starts expanded to the pressure of the gas, at the static temperature and
speed of an isentropic expansion, which is far below the temperature in the injector.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.spray.fuel import METHANE
from cldit.spray.mixing import Floats, rising_root


@dataclass(frozen=True)
class Expansion:
    """Methane expanded from rest to the pressure of the gas around.

    flux_kg_m2_s: through the narrowest section, choked where the pressure allows it.
    """

    flux_kg_m2_s: float
    speed_m_s: float
    temperature_K: float
    density_kg_m3: float


def expand(*, stagnation_Pa: float, stagnation_K: float, pressure_Pa: float) -> Expansion:
    """Isentropic expansion of methane at rest to a lower pressure."""
    gas = METHANE.gas_constant_J_kg_K
    pressure = np.linspace(pressure_Pa, stagnation_Pa, 2001)
    entropy = METHANE.entropy_J_kg_K(stagnation_K) + gas * np.log(pressure / stagnation_Pa)

    def excess(temperature: Floats) -> Floats:
        return METHANE.entropy_J_kg_K(temperature) - entropy

    top = np.full(pressure.shape, stagnation_K)
    temperature = rising_root(excess, np.ones(pressure.shape), top)
    drop = METHANE.enthalpy_J_kg(stagnation_K) - METHANE.enthalpy_J_kg(temperature)
    speed = np.sqrt(2 * np.maximum(drop, 0.0))
    density = pressure / (gas * temperature)
    return Expansion(
        flux_kg_m2_s=float(np.max(density * speed)),
        speed_m_s=float(speed[0]),
        temperature_K=float(temperature[0]),
        density_kg_m3=float(density[0]),
    )
