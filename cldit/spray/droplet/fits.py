"""Properties of a fuel and a carrier gas as polynomials, for kernels/droplet_properties.h."""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.spray.droplet.curves import Curves
from cldit.spray.droplet.fluids import Fuel, Gas, diffusivity_m2_s
from cldit.spray.droplet.substances import GAS_CONSTANT_J_mol_K

# Numbers of coefficients, as in the header.
LIQUID_TERMS = 12
GAS_TERMS = 11

# Published property fits of one fuel differ by 1 % (n-heptane: NSRDS and CoolProp); a third of it.
LARGEST_ERROR = 3e-3
LARGEST_LN_ERROR = 1e-3  # of the logarithm of the saturation pressure

_LIQUID = ("ln_psat", "density", "cp", "latent", "conductivity", "enthalpy")
_GAS = ("cp", "conductivity", "viscosity")
_POINTS = 400


def property_fits(fuel: Fuel, gas: Gas) -> Floats:
    """Table of the header: constants, ranges, and coefficients of all properties.

    Raises SprayError if a polynomial differs from the property by more than `LARGEST_ERROR`.
    """
    lighter = gas.molar_mass_kg_mol / fuel.molar_mass_kg_mol
    diffusion = float(diffusivity_m2_s(fuel, gas, temperature_K=1.0, pressure_Pa=1.0))
    constants = [
        1 / fuel.molar_mass_kg_mol,
        1 / gas.molar_mass_kg_mol,
        lighter,
        lighter**0.25,
        1 / np.sqrt(8 * (1 + 1 / lighter)),
        diffusion / GAS_CONSTANT_J_mol_K,
        1 / fuel.critical_K,
    ]
    ends = np.array([fuel.liquid.low_K, fuel.liquid.high_K]) / fuel.critical_K
    cold, warm = np.cbrt(1 - ends)
    ranges = [fuel.liquid.low_K, fuel.liquid.high_K, *_scale(warm, cold)]
    for vapour in (fuel.vapour, gas.vapour):
        roots = np.sqrt(vapour.low_K), np.sqrt(vapour.high_K)
        ranges += [vapour.low_K, vapour.high_K, *_scale(*roots)]
    coefficients = _liquid_fits(fuel, warm, cold)
    for substance in (fuel, gas):
        coefficients += _gas_fits(substance.name, substance.vapour)
    return np.concatenate([constants, ranges, *coefficients])


def _scale(low: float, high: float) -> tuple[float, float]:
    """Factor and summand that map low..high to -1..1."""
    return 2 / (high - low), -(high + low) / (high - low)


def _places(low: float, high: float) -> tuple[Floats, Floats]:
    """Chebyshev points of -1..1, and where they are in low..high."""
    u = np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
    return u, 0.5 * (low + high) + 0.5 * (high - low) * u


def _liquid_fits(fuel: Fuel, warm: float, cold: float) -> list[Floats]:
    u, root = _places(warm, cold)
    reduced = 1 - root**3
    columns = fuel.liquid.at(reduced * fuel.critical_K, *_LIQUID)
    fits = []
    for name, column in zip(_LIQUID, columns, strict=True):
        values, scale, limit = column, np.abs(column), LARGEST_ERROR
        if name == "ln_psat":
            values, scale, limit = column * reduced, reduced, LARGEST_LN_ERROR
        if name == "enthalpy":  # has a zero; its differences count
            scale = np.full_like(column, np.ptp(column))
        fits.append(_fit(f"{fuel.name}, liquid {name}", u, values, scale, LIQUID_TERMS, limit))
    return fits


def _gas_fits(name: str, vapour: Curves) -> list[Floats]:
    u, root = _places(np.sqrt(vapour.low_K), np.sqrt(vapour.high_K))
    return [
        _fit(f"{name}, gas {each}", u, values, np.abs(values), GAS_TERMS, LARGEST_ERROR)
        for each, values in zip(_GAS, vapour.at(root**2, *_GAS), strict=True)
    ]


def _fit(name: str, u: Floats, values: Floats, scale: Floats, terms: int, limit: float) -> Floats:
    """Coefficients of the powers of u, highest first, for the least error over `scale`."""
    basis = np.polynomial.chebyshev.chebvander(u, terms - 1)
    series = np.linalg.lstsq(basis / scale[:, None], values / scale, rcond=None)[0]
    error = float(np.abs((basis @ series - values) / scale).max())
    if not error <= limit:
        raise SprayError(
            f"{name}: a polynomial of {terms} terms has an error of {error:.1g}; allowed: {limit:g}"
        )
    return np.asarray(np.polynomial.chebyshev.cheb2poly(series)[::-1])
