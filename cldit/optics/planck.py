"""Planck's law for photons over a rectangular filter, and its inverse.

    B_q(lambda, T) = 2 c / lambda^4 / (exp(x) - 1),   x = h c / (lambda k T)

in photons s-1 m-2 sr-1 m-1 (Planck 1901, divided by the photon's energy). With c2 = h c / k,

    B(T) = integral over the filter = 2 c (T / c2)^3 * integral of x^2 / (exp(x) - 1) dx.

The integral is taken by Gauss-Legendre in x with exp(-x) of the long-wave edge taken out, so that
ln B is exact where B itself would underflow. The integrand's nearest poles are at +-2 pi i; nodes
beyond 50 of the edge add less than 1e-20.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from cldit.errors import SceneError

Floats = NDArray[np.float64]

LIGHT_SPEED_m_s = 299792458.0  # exact in the SI
SECOND_RADIATION_CONSTANT_m_K = 6.62607015e-34 * 299792458.0 / 1.380649e-23  # h c / k, exact

_REACH = 50.0  # exp(-50) = 2e-22
_CHUNK = 1 << 16
_SPAN = (1e-8, 2000.0)  # x of the inverse's table; float64 radiance ends near x = 850
_NODES = 16384  # cubic Hermite: (26 / 16384)^4 * 6 / 384 = 1e-13


def _edges(filter_um: tuple[float, float]) -> tuple[float, float]:
    low, high = filter_um
    if not 0.0 < low < high < np.inf:
        raise SceneError(
            f"filter_um: {low:g} to {high:g} is no filter; allowed is a lower and a higher "
            "wavelength, both above 0"
        )
    return low * 1e-6, high * 1e-6


@lru_cache(maxsize=64)
def _legendre(count: int) -> tuple[Floats, Floats]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _log_band(temperature_K: Floats, edges_m: tuple[float, float]) -> tuple[Floats, Floats]:
    """ln B and d ln B / d ln T of positive, finite temperatures (N,)."""
    short, long = edges_m
    start = SECOND_RADIATION_CONSTANT_m_K / (long * temperature_K)
    width = np.minimum(start * (long / short - 1.0), _REACH)
    # exp(-t) over a width w is exact to 1e-15 from n = 9 + 0.8 w nodes on.
    nodes, weights = _legendre(9 + int(0.8 * np.max(width, initial=0.0)))
    beyond = width[:, None] * nodes
    x = start[:, None] + beyond
    damped = x * x * np.exp(-beyond)
    one_less = -np.expm1(-x)
    integral = (damped / one_less) @ weights
    # dB/dT at fixed wavelength: x e^x / (e^x - 1) / T times the integrand.
    moment = (damped * x / one_less**2) @ weights
    cubed = 3.0 * np.log(temperature_K / SECOND_RADIATION_CONSTANT_m_K)
    log_band = np.log(2.0 * LIGHT_SPEED_m_s) + cubed + np.log(width * integral) - start
    return log_band, moment / integral


def _evaluate(
    temperature_K: ArrayLike, filter_um: tuple[float, float], *, slope: bool
) -> NDArray[np.float64]:
    edges = _edges(filter_um)
    temperature = np.asarray(temperature_K, dtype=np.float64)
    flat = temperature.ravel()
    out = np.where(flat == 0.0, 0.0, np.nan)
    if not slope:
        out[np.isposinf(flat)] = np.inf
    else:  # B grows as T: 2 c (1 / lambda_1^2 - 1 / lambda_2^2) / (2 c2)
        limit = LIGHT_SPEED_m_s / SECOND_RADIATION_CONSTANT_m_K
        out[np.isposinf(flat)] = limit * (edges[0] ** -2 - edges[1] ** -2)
    usable = np.flatnonzero(np.isfinite(flat) & (flat > 0.0))
    for begin in range(0, usable.size, _CHUNK):
        part = usable[begin : begin + _CHUNK]
        # At a subnormal temperature x overflows to infinity; a picokelvin has B = 0 as well.
        kelvin = np.maximum(flat[part], 1e-12)
        log_band, power = _log_band(kelvin, edges)
        if slope:
            log_band = log_band + np.log(power) - np.log(kelvin)
        with np.errstate(under="ignore", over="ignore"):
            out[part] = np.exp(log_band)
    return out.reshape(temperature.shape)


def band_radiance(
    temperature_K: ArrayLike, *, filter_um: tuple[float, float]
) -> NDArray[np.float64]:
    """Photon radiance of a black body in a rectangular filter, photons s-1 m-2 sr-1.

    Relative error below 1e-11 where the result is a normal float64; below that (3.4 um: under
    6 K) it runs out to exactly 0. 0 K gives 0, infinity gives infinity, negative temperatures and
    NaN give NaN.

    Args:
        temperature_K: any shape; the result has the same.
        filter_um: lower and upper wavelength.

    Raises:
        SceneError: the filter is empty or not positive.
    """
    return _evaluate(temperature_K, filter_um, slope=False)


def band_radiance_slope(
    temperature_K: ArrayLike, *, filter_um: tuple[float, float]
) -> NDArray[np.float64]:
    """d B / d T in photons s-1 m-2 sr-1 K-1; otherwise as `band_radiance`."""
    return _evaluate(temperature_K, filter_um, slope=True)


@lru_cache(maxsize=8)
def _inverse(edges_m: tuple[float, float]) -> tuple[CubicHermiteSpline, Floats]:
    """ln T over ln B, and both at the ends of the table."""
    x = np.geomspace(_SPAN[1], _SPAN[0], _NODES)
    temperature = SECOND_RADIATION_CONSTANT_m_K / (edges_m[1] * x)
    log_band, power = _log_band(temperature, edges_m)
    spline = CubicHermiteSpline(log_band, np.log(temperature), 1.0 / power)
    return spline, np.array([log_band[-1], np.log(temperature[-1])])


def _invert(
    radiance: ArrayLike, filter_um: tuple[float, float], *, slope: bool
) -> NDArray[np.float64]:
    spline, (top, log_temperature) = _inverse(_edges(filter_um))
    value = np.asarray(radiance, dtype=np.float64)
    out = np.where(value == 0.0, np.inf if slope else 0.0, np.nan)
    out[np.isposinf(value)] = np.inf
    usable = np.isfinite(value) & (value > 0.0)
    log_band = np.log(value[usable])
    inside = np.minimum(log_band, top)
    # Above the table (x < 1e-8, 4e11 K at 3.4 um) B grows in proportion to T.
    found = np.exp(spline(inside) + (log_band - inside))
    if slope:
        with np.errstate(over="ignore"):
            found = found * spline(inside, 1) / value[usable]
        last = np.exp(log_temperature - top)  # Rayleigh-Jeans: dT/dB is constant
        out[np.isposinf(value)] = last
    out[usable] = found
    return np.asarray(out)


def temperature_of_radiance(
    radiance: ArrayLike, *, filter_um: tuple[float, float]
) -> NDArray[np.float64]:
    """Temperature in K at which a black body has this radiance: the inverse of `band_radiance`.

    Read from a table of ln T over ln B with exact slopes, relative error below 1e-12; a million
    pixels take a tenth of a second. 0 gives 0 K, infinity gives infinity, negative radiances and
    NaN give NaN.

    Args:
        radiance: photons s-1 m-2 sr-1, any shape; the result has the same.
        filter_um: lower and upper wavelength.

    Raises:
        SceneError: the filter is empty or not positive.
    """
    return _invert(radiance, filter_um, slope=False)


def temperature_slope_of_radiance(
    radiance: ArrayLike, *, filter_um: tuple[float, float]
) -> NDArray[np.float64]:
    """d T / d B in K per photons s-1 m-2 sr-1; infinite at 0, otherwise as the temperature."""
    return _invert(radiance, filter_um, slope=True)
