"""Properties as polynomials of given length, for kernels/spray/droplet_properties.h."""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.spray.droplet.curves import Curves

# Numbers of coefficients, as in the header.
LIQUID_TERMS = 12
GAS_TERMS = 11

# Published property fits of one fuel differ by 1 % (n-heptane: NSRDS and CoolProp); a third of it.
LARGEST_ERROR = 3e-3
LARGEST_LN_ERROR = 1e-3  # of the logarithm of the saturation pressure

_LIQUID = ("ln_psat", "density", "cp", "latent", "conductivity", "enthalpy")
_GAS = ("cp", "conductivity", "viscosity")
_POINTS = 400  # 33 times the terms or more, so that no oscillation of the error is missed


def liquid_fits(fuel: str, curves: Curves, *, critical_K: float) -> tuple[Floats, Floats]:
    """Range of a saturated liquid for the header (4,), and coefficients of its properties.

    Raises SprayError if a polynomial differs from the property by more than `LARGEST_ERROR`.
    """
    cold, warm = np.cbrt(1 - np.array([curves.low_K, curves.high_K]) / critical_K)
    u, root = _places(warm, cold)
    reduced = 1 - root**3
    fits = []
    for name, column in zip(_LIQUID, curves.at(reduced * critical_K, *_LIQUID), strict=True):
        values, scale, limit = column, np.abs(column), LARGEST_ERROR
        if name == "ln_psat":
            values, scale, limit = column * reduced, reduced, LARGEST_LN_ERROR
        if name == "enthalpy":  # has a zero; its differences count
            scale = np.full_like(column, np.ptp(column))
        fits.append(_fit(f"{fuel}, liquid {name}", u, values, scale, LIQUID_TERMS, limit))
    return np.array([curves.low_K, curves.high_K, *_scale(warm, cold)]), np.concatenate(fits)


def gas_fits(gas: str, curves: Curves) -> tuple[Floats, Floats]:
    """The same of a dilute gas."""
    ends = float(np.sqrt(curves.low_K)), float(np.sqrt(curves.high_K))
    u, root = _places(*ends)
    fits = [
        _fit(f"{gas}, gas {name}", u, values, np.abs(values), GAS_TERMS, LARGEST_ERROR)
        for name, values in zip(_GAS, curves.at(root**2, *_GAS), strict=True)
    ]
    return np.array([curves.low_K, curves.high_K, *_scale(*ends)]), np.concatenate(fits)


def _scale(low: float, high: float) -> tuple[float, float]:
    """Factor and summand that map low..high to -1..1."""
    return 2 / (high - low), -(high + low) / (high - low)


def _places(low: float, high: float) -> tuple[Floats, Floats]:
    """Chebyshev points of -1..1, and where they are in low..high."""
    u = np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
    return u, 0.5 * (low + high) + 0.5 * (high - low) * u


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
