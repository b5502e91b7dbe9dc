"""Mixture of carrier gas and fuel vapour: ideal gases, enthalpies as polynomials of temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K
from cldit.spray.droplet.fluids import Fuel, Gas

LOWEST_K, _HIGH_K = 150.0, 1200.0  # of the polynomials
_DEGREE = 7  # of the enthalpies: within 75 J/kg of the tables from 200 to 1200 K
_SCALE_K = 1000.0  # makes the variable of the polynomials of order 1


@dataclass(frozen=True)
class GasMixture:
    """Mixture whose enthalpies are 0 at `reference_K` for both gases.

    carrier, vapour: (N,) coefficients of the enthalpies (J/kg) in powers of (T - reference) / 1000
    K, from the first power on. zero_J_kg: difference from the zero of the fuel's tables.
    """

    reference_K: float
    carrier: Floats
    vapour: Floats
    carrier_J_kg_K: float
    vapour_J_kg_K: float
    zero_J_kg: float

    def enthalpy_J_kg(self, share: Floats, temperature_K: Floats) -> Floats:
        """Enthalpy for the mass fraction `share` of fuel vapour, any shape."""
        x = (np.asarray(temperature_K) - self.reference_K) / _SCALE_K
        powers = [x ** (n + 1) for n in range(_DEGREE)]
        parts = zip(self.carrier, self.vapour, powers, strict=True)
        return np.asarray(sum(((1 - share) * c + share * v) * x for c, v, x in parts))


def gas_mixture(fuel: Fuel, carrier: Gas, *, reference_K: float) -> GasMixture:
    """Mixture of `fuel` vapour and `carrier`, fitted to their tables."""
    low = max(LOWEST_K, fuel.vapour.low_K, carrier.vapour.low_K)
    t = np.linspace(low, min(_HIGH_K, fuel.vapour.high_K, carrier.vapour.high_K), 400)
    x = (t - reference_K) / _SCALE_K
    powers = np.stack([x ** (n + 1) for n in range(_DEGREE)], axis=1)
    fits = []
    for gas in (carrier, fuel):
        rise = gas.vapour.value("enthalpy", t) - gas.vapour.value("enthalpy", reference_K)
        fits.append(np.asarray(np.linalg.lstsq(powers, rise, rcond=None)[0], dtype=np.float64))
    return GasMixture(
        reference_K=reference_K,
        carrier=fits[0],
        vapour=fits[1],
        carrier_J_kg_K=GAS_CONSTANT_J_mol_K / carrier.molar_mass_kg_mol,
        vapour_J_kg_K=GAS_CONSTANT_J_mol_K / fuel.molar_mass_kg_mol,
        zero_J_kg=float(fuel.vapour.value("enthalpy", reference_K)),
    )
