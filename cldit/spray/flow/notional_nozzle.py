"""Under-expanded gas: the choked hole, the shock below it, and the notional nozzle.

The gas is ideal, of variable heat capacity, without losses up to the narrowest section. There the
flow is sonic if the pressure allows it, and its pressure exceeds that of the surrounding gas. It
expands further in a shock barrel that ends with a Mach disc, at 0.67 sqrt(p0/p) hole diameters
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
from cldit.constants import GAS_CONSTANT_J_mol_K
from cldit.spray.droplet.curves import integral
from cldit.spray.droplet.fluids import Gas

MACH_DISC = 0.67  # times sqrt(p0/p), in hole diameters, for any gas
_SECTIONS = 4001  # pressures between rest and the surrounding gas


@dataclass(frozen=True)
class Expansion:
    """Expansion of a gas from rest to the notional nozzle, at the pressure of the gas around.

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

    def diameter_m(self, rate_kg_s: Floats) -> Floats:
        """Diameter of the notional nozzle of a flow, any shape."""
        hole = np.sqrt(4 * rate_kg_s / (np.pi * self.flux_kg_m2_s))
        return np.asarray(hole * float(np.sqrt(self.area)))


def expand(gas: Gas, *, stagnation_Pa: float, stagnation_K: float, pressure_Pa: float) -> Expansion:
    """Expands a gas from rest in the injector into another one of a lower pressure."""
    constant = GAS_CONSTANT_J_mol_K / gas.molar_mass_kg_mol
    table_K = np.linspace(gas.vapour.low_K, stagnation_K, _SECTIONS)
    cp, enthalpy = gas.vapour.at(table_K, "cp", "enthalpy")
    entropy = integral(table_K, cp / table_K)
    pressure = np.linspace(pressure_Pa, stagnation_Pa, _SECTIONS)
    isentrope = entropy[-1] + constant * np.log(pressure / stagnation_Pa)
    temperature: Floats = np.interp(isentrope, entropy, table_K)
    rise = enthalpy[-1] - gas.vapour.value("enthalpy", temperature)
    speed = np.sqrt(2 * np.maximum(rise, 0.0))
    flux = pressure / (constant * temperature) * speed
    throat = int(np.argmax(flux))
    fast = float(speed[throat] + (pressure[throat] - pressure_Pa) / flux[throat])
    cold = float(np.interp(enthalpy[-1] - 0.5 * fast**2, enthalpy, table_K))
    density = pressure_Pa / (constant * cold)
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
