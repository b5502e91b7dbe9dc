"""Properties of n-heptane and nitrogen: fits with their sources, SI, for arrays.

n-heptane: coefficients of the NSRDS/DIPPR fits as tabulated by OpenFOAM (C7H16). Nitrogen: CHEMKIN
thermodynamic data base. Gases are ideal. Enthalpies are relative to an
arbitrary zero of each substance; liquid and vapour of n-heptane share theirs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K

HEPTANE_CRITICAL_K = 540.20
HEPTANE_CRITICAL_Pa = 2.74e6
HEPTANE_BOILING_K = 371.58
HEPTANE_DIFFUSION_VOLUME = 148.26  # Fuller, Ensley and Giddings: 7 C and 16 H, cm3/mol
NITROGEN_DIFFUSION_VOLUME = 18.5
NITROGEN_MOLAR_MASS_kg_mol = 0.0280134
NITROGEN_LOW_K, NITROGEN_MID_K = 200.0, 1000.0  # ranges of its two polynomials begin
# Of heat capacities: a to d of NSRDS 14, a to e of NSRDS 7 (J/(kg K) and K), and two NASA
# polynomials in T of cp over the gas constant.
COEFFICIENTS: dict[str, tuple[tuple[float, ...], ...]] = {
    "heptane liquid cp": (
        (6.11976102401216, 3137.69909384855, 182.274175063868, -254.530511150515),
    ),
    "heptane vapour cp": ((1199.05392998284, 3992.85457666361, 1676.6, 2734.42177956968, 756.4),),
    "nitrogen cp": (
        (3.298677, 1.4082404e-3, -3.963222e-6, 5.641515e-9, -2.444854e-12),
        (2.926640, 1.4879768e-3, -5.684760e-7, 1.0097038e-10, -6.753351e-15),
    ),
}
HEPTANE_LIQUID_MAX_K = 535.0  # cp of the liquid diverges at the critical point; constant from here


def heptane_saturation_pressure_Pa(temperature_K: ArrayLike) -> Floats:
    """Saturation pressure, NSRDS 1: ln p = a + b/T + c ln T + d T^2, 183 to 540 K; any shape."""
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(np.exp(87.829 - 6996.4 / t - 9.8802 * np.log(t) + 7.2099e-6 * t * t))


def heptane_density_kg_m3(temperature_K: ArrayLike) -> Floats:
    """Density of saturated liquid, NSRDS 5: rho = a / b^(1 + (1 - T/Tc)^d); any shape."""
    t = np.minimum(np.asarray(temperature_K, dtype=float), HEPTANE_CRITICAL_K)
    return np.asarray(61.38396836 / 0.26211 ** (1 + (1 - t / HEPTANE_CRITICAL_K) ** 0.28141))


def heptane_latent_heat_J_kg(temperature_K: ArrayLike) -> Floats:
    """Latent heat, NSRDS 6: L = a (1 - T/Tc)^b; any shape."""
    t = np.minimum(np.asarray(temperature_K, dtype=float), HEPTANE_CRITICAL_K)
    return np.asarray(499121.791545248 * (1 - t / HEPTANE_CRITICAL_K) ** 0.38795)


def heptane_liquid_cp_J_kg_K(temperature_K: ArrayLike) -> Floats:
    """Heat capacity of the liquid, NSRDS 14 in t = 1 - T/Tc; any shape.

    a^2/t + b - 2act - adt^2 - c^2t^3/3 - cdt^4/2 - d^2t^5/5
    """
    ((a, b, c, d),) = COEFFICIENTS["heptane liquid cp"]
    t = (
        1
        - np.minimum(np.asarray(temperature_K, dtype=float), HEPTANE_LIQUID_MAX_K)
        / HEPTANE_CRITICAL_K
    )
    slow = t * (2 * a * c + t * (a * d + t * (c * c / 3 + t * (c * d / 2 + t * d * d / 5))))
    return np.asarray(a * a / t + b - slow)


def heptane_vapour_cp_J_kg_K(temperature_K: ArrayLike) -> Floats:
    """Heat capacity of the vapour, NSRDS 7 (Aly and Lee), any shape.

    a + b (c/T / sinh(c/T))^2 + d (e/T / cosh(e/T))^2
    """
    ((a, b, c, d, e),) = COEFFICIENTS["heptane vapour cp"]
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(a + b * (c / t / np.sinh(c / t)) ** 2 + d * (e / t / np.cosh(e / t)) ** 2)


def _liquid_integral(temperature_K: Floats) -> Floats:
    """Integral of the liquid's cp over T, by the closed form of NSRDS 14."""
    ((a, b, c, d),) = COEFFICIENTS["heptane liquid cp"]
    held = np.minimum(temperature_K, HEPTANE_LIQUID_MAX_K)
    t = 1 - held / HEPTANE_CRITICAL_K
    powers = (
        a * a * np.log(t)
        + b * t
        - t * t * (a * c + t * (a * d / 3 + t * (c * c / 12 + t * (c * d / 10 + t * d * d / 30))))
    )
    beyond = (temperature_K - held) * heptane_liquid_cp_J_kg_K(HEPTANE_LIQUID_MAX_K)
    return np.asarray(-HEPTANE_CRITICAL_K * powers + beyond)


def _vapour_integral(temperature_K: Floats) -> Floats:
    ((a, b, c, d, e),) = COEFFICIENTS["heptane vapour cp"]
    t = temperature_K
    return np.asarray(a * t + b * c / np.tanh(c / t) - d * e * np.tanh(e / t))


def heptane_liquid_enthalpy_J_kg(temperature_K: ArrayLike) -> Floats:
    """Enthalpy of the liquid, 0 at the normal boiling point and for all pressures; any shape."""
    t = np.asarray(temperature_K, dtype=float)
    return _liquid_integral(t) - _liquid_integral(np.asarray(HEPTANE_BOILING_K))


def heptane_vapour_enthalpy_J_kg(temperature_K: ArrayLike) -> Floats:
    """Enthalpy of the vapour, from the latent heat at the normal boiling point and cp; any shape.

    Energy is conserved on every path. The resulting latent heat at other temperatures (Kirchhoff,
    ideal vapour) is within 2 % of `heptane_latent_heat_J_kg` from 280 to 390 K, where the mixtures
    of a spray are saturated, and 7 % above it at 440 K.
    """
    t = np.asarray(temperature_K, dtype=float)
    start = heptane_latent_heat_J_kg(HEPTANE_BOILING_K)
    return start + _vapour_integral(t) - _vapour_integral(np.asarray(HEPTANE_BOILING_K))


def nitrogen_cp_J_kg_K(temperature_K: ArrayLike) -> Floats:
    """Heat capacity at constant pressure, any shape; constant below `NITROGEN_LOW_K`."""
    t = np.maximum(np.asarray(temperature_K, dtype=float), NITROGEN_LOW_K)
    ratio = np.where(t < NITROGEN_MID_K, *(_horner(row, t) for row in COEFFICIENTS["nitrogen cp"]))
    return np.asarray(ratio * (GAS_CONSTANT_J_mol_K / NITROGEN_MOLAR_MASS_kg_mol))


def nitrogen_enthalpy_J_kg(temperature_K: ArrayLike) -> Floats:
    """Enthalpy, zero at `NITROGEN_MID_K`; any shape."""
    t = np.asarray(temperature_K, dtype=float)
    held = np.maximum(t, NITROGEN_LOW_K)
    heats = []
    for row in COEFFICIENTS["nitrogen cp"]:
        slope = tuple(value / (power + 1) for power, value in enumerate(row))
        end = NITROGEN_MID_K * _horner(slope, NITROGEN_MID_K)
        heats.append(held * _horner(slope, held) - end)
    rise = np.where(held < NITROGEN_MID_K, *heats)
    cold = (t - held) * nitrogen_cp_J_kg_K(NITROGEN_LOW_K)
    return np.asarray(rise * (GAS_CONSTANT_J_mol_K / NITROGEN_MOLAR_MASS_kg_mol) + cold)


def _horner(coefficients: tuple[float, ...], t: Floats | float) -> Floats:
    result = np.zeros_like(np.asarray(t, dtype=float))
    for value in reversed(coefficients):
        result = result * t + value
    return result


def heptane_vapour_conductivity_W_m_K(temperature_K: ArrayLike) -> Floats:
    """Conductivity of the vapour, NSRDS 2: a T^b / (1 + c/T + d/T^2); any shape."""
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(-0.070028 * t**0.38068 / (1 - 7049.9 / t - 2400500.0 / (t * t)))


def nitrogen_conductivity_W_m_K(temperature_K: ArrayLike) -> Floats:
    """Conductivity of nitrogen, DIPPR 102: a T^b / (1 + c/T + d/T^2); any shape."""
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(3.3143e-4 * t**0.7722 / (1 + 16.323 / t + 373.72 / (t * t)))


def heptane_liquid_conductivity_W_m_K(temperature_K: ArrayLike) -> Floats:
    """Conductivity of the liquid, NSRDS 0: a + b T; any shape."""
    return np.asarray(0.215 - 3.03e-4 * np.asarray(temperature_K, dtype=float))


def heptane_vapour_viscosity_Pa_s(temperature_K: ArrayLike) -> Floats:
    """Viscosity of the vapour, NSRDS 2: a T^b / (1 + c/T); any shape."""
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(6.672e-8 * t**0.82837 / (1 + 85.752 / t))


def nitrogen_viscosity_Pa_s(temperature_K: ArrayLike) -> Floats:
    """Sutherland's formula, any shape: 1.663e-5 Pa s at 273 K, S = 107 K (White, Viscous Flow)."""
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(1.663e-5 * (t / 273.0) ** 1.5 * (273.0 + 107.0) / (t + 107.0))
