"""Under-expanded methane: the choked hole, the shock below it, and the notional nozzle.

Methane is an ideal gas of variable heat capacity, without losses up to the narrowest section. There
the flow is sonic if the pressure allows it, and its pressure exceeds that of the surrounding gas.
It expands further in a shock barrel that ends with a Mach disc, at 0.67 sqrt(p0/p) hole diameters
(S. Crist, P. M. Sherman, D. R. Glass, AIAA J. 4, 68 (1966); H. Ashkenas, F. S. Sherman, Rarefied
Gas Dynamics 4 (1966)). Beyond it is a jet at the pressure of the gas, from a notional nozzle that
conserves mass, momentum and energy (A. L. Birch, D. J. Hughes, F. Swaffield, Combust. Sci. Technol.
52, 161 (1987), with the energy balance of K. B. Yüceil, M. V. Ötügen, Phys. Fluids 14, 4206
(2002)): u = u* + (p* - p) / (rho* u*), h = h0 - u^2/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.spray.cone.fluid_properties import METHANE
from cldit.spray.cone.mixing import rising_root

MACH_DISC = 0.67  # times sqrt(p0/p), in hole diameters, for any gas


@dataclass(frozen=True)
class Expansion:
    """Expansion of methane from rest to the notional nozzle, at the pressure of the gas.

    flux_kg_m2_s, throat_Pa, throat_K, throat_m_s: in the narrowest section, sonic if the pressure
    allows it. speed, temperature, density: at the notional nozzle, where the jet begins. area: of
    the notional nozzle over that of the flow in the hole. disc: distance of the Mach disc from the
    hole in hole diameters, 0 without choking.
    """

    flux_kg_m2_s: float
    throat_Pa: float
    throat_K: float
    throat_m_s: float
    speed_m_s: float
    temperature_K: float
    density_kg_m3: float
    area: float
    disc: float


def expand(*, stagnation_Pa: float, stagnation_K: float, pressure_Pa: float) -> Expansion:
    """Expands methane from rest in the injector into gas of a lower pressure."""
    gas = METHANE.gas_constant_J_kg_K
    pressure = np.linspace(pressure_Pa, stagnation_Pa, 4001)
    entropy = METHANE.entropy_J_kg_K(stagnation_K) + gas * np.log(pressure / stagnation_Pa)

    def excess(temperature: Floats) -> Floats:
        return METHANE.entropy_J_kg_K(temperature) - entropy

    top = np.full(pressure.shape, stagnation_K)
    temperature = rising_root(excess, np.ones(pressure.shape), top)
    whole = float(METHANE.enthalpy_J_kg(stagnation_K))
    speed = np.sqrt(2 * np.maximum(whole - METHANE.enthalpy_J_kg(temperature), 0.0))
    flux = pressure / (gas * temperature) * speed
    throat = int(np.argmax(flux))
    fast = float(speed[throat] + (pressure[throat] - pressure_Pa) / flux[throat])
    left = np.array([whole - 0.5 * fast**2])
    cold = float(rising_root(lambda t: METHANE.enthalpy_J_kg(t) - left, np.ones(1), top[:1])[0])
    density = pressure_Pa / (gas * cold)
    return Expansion(
        flux_kg_m2_s=float(flux[throat]),
        throat_Pa=float(pressure[throat]),
        throat_K=float(temperature[throat]),
        throat_m_s=float(speed[throat]),
        speed_m_s=fast,
        temperature_K=cold,
        density_kg_m3=density,
        area=float(flux[throat]) / (density * fast),
        disc=MACH_DISC * float(np.sqrt(stagnation_Pa / pressure_Pa)) if throat > 0 else 0.0,
    )
