"""Droplet sizes: moments, quantiles and representative diameters in closed form.

Nukiyama-Tanasawa: f(D) = n D^p exp(-(D/m)^n) / (m^(p+1) Gamma((p+1)/n)), paper Eq. (5). Then
(D/m)^n has a Gamma distribution, of shape (p+1)/n by number of droplets and (p+4)/n by mass.
Rosin-Rammler, with the mass share exp(-(D/d)^q) above D, is the same with p = q - 4 and n = q;
below q = 3 the number of droplets is infinite, and D10 does not exist.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.scene.sizes import Histogram, LogNormal, Monodisperse, NukiyamaTanasawa, RosinRammler

Sizes = NukiyamaTanasawa | Monodisperse | LogNormal | RosinRammler | Histogram
Weight = Literal["number", "mass"]

FREE_DROP_M = 5e-3  # a larger free drop of fuel breaks up
_POWER = {"number": 0, "mass": 3}


def mean_diameter_m(sizes: Sizes, high: int, low: int) -> float:
    """Mean diameter D_high,low = (<D^high> / <D^low>)^(1/(high - low)).

    D32 is paper Eq. (6), D10 the mean. Raises SprayError if the moment does not exist
    (Rosin-Rammler, order + q <= 3), and ValueError for equal orders.
    """
    if high == low:
        raise ValueError(f"D{high}{low}: the two orders must differ")
    if isinstance(sizes, Monodisperse):
        return sizes.diameter_um * 1e-6
    scale, logs = _log_moments(sizes, np.array([high, low], dtype=float))
    return float(scale * np.exp((logs[0] - logs[1]) / (high - low)))


def _log_moments(sizes: Sizes, orders: Floats) -> tuple[float, Floats]:
    """Length scale, and ln <(D / length)^order>, up to a constant."""
    if isinstance(sizes, LogNormal):
        spread = np.log(sizes.sigma)
        return sizes.median_um * 1e-6, 0.5 * (orders * spread) ** 2
    if isinstance(sizes, Histogram):
        scale = sizes.edges_um[-1]
        edges = np.array(sizes.edges_um) / scale
        number = np.array(sizes.number) / np.diff(edges)
        sums = [np.sum(number * np.diff(edges ** (order + 1))) / (order + 1) for order in orders]
        return scale * 1e-6, np.log(sums)
    if isinstance(sizes, Monodisperse):
        return sizes.diameter_um * 1e-6, np.zeros_like(orders)
    m_um, n, p = _gamma(sizes)
    shapes = (p + 1 + orders) / n
    if np.any(shapes <= 0):
        raise SprayError(
            f"Rosin-Rammler with q = {n:g} has no moment of order {orders[shapes <= 0][0]:g}: "
            f"it needs q above {3 - orders[shapes <= 0][0]:g}"
        )
    return m_um * 1e-6, scipy.special.gammaln(shapes)


def quantile_m(sizes: Sizes, share: ArrayLike, *, by: Weight) -> Floats:
    """Diameter below which a share, of any shape, of the droplets or of their mass is.

    Raises SprayError by number if the number is infinite (Rosin-Rammler, q <= 3).
    """
    shares = np.asarray(share, dtype=float)
    if isinstance(sizes, Monodisperse):
        return np.full(shares.shape, sizes.diameter_um * 1e-6)
    if isinstance(sizes, LogNormal):
        spread = np.log(sizes.sigma)
        shift = _POWER[by] * spread**2
        return np.asarray(
            sizes.median_um * 1e-6 * np.exp(shift + spread * scipy.special.ndtri(shares))
        )
    if isinstance(sizes, Histogram):
        edges, below = _running(sizes, _POWER[by])
        power = _POWER[by] + 1
        powers = np.interp(shares * below[-1], below, edges**power)
        return np.asarray(powers ** (1 / power) * 1e-6)
    m_um, n, _, shape = _weighted(sizes, by)
    return np.asarray(m_um * 1e-6 * scipy.special.gammaincinv(shape, shares) ** (1 / n))


def strata_m(sizes: Sizes, count: int) -> Floats:
    """Rising diameters (count,) of a distribution, for `count` equal shares of the mass.

    Each has the surface per mass of its share, so droplets of these diameters, equal in mass, have
    the distribution's D32 exactly: 1/D32 is the mean of 1/D by mass.
    """
    edges = np.linspace(0.0, 1.0, count + 1)
    if isinstance(sizes, Monodisperse):
        return np.full(count, sizes.diameter_um * 1e-6)
    if isinstance(sizes, LogNormal):
        # 1/D times the mass is again log-normal in D, with its median one sigma^2 lower.
        spread = np.log(sizes.sigma)
        surface = scipy.special.ndtr(scipy.special.ndtri(edges) + spread)
        d32 = sizes.median_um * 1e-6 * np.exp(2.5 * spread**2)
        return np.asarray(d32 / (count * np.diff(surface)))
    if isinstance(sizes, Histogram):
        bounds = quantile_m(sizes, edges, by="mass") * 1e6
        corners, surface = _running(sizes, 2)
        below = np.interp(bounds**3, corners**3, surface)
        mass = _running(sizes, 3)[1][-1]
        return np.asarray(mass / (count * np.diff(below)) * 1e-6)
    m_um, n, _, shape = _weighted(sizes, "mass")
    surface_below = scipy.special.gammainc(shape - 1 / n, scipy.special.gammaincinv(shape, edges))
    total = np.exp(scipy.special.gammaln(shape - 1 / n) - scipy.special.gammaln(shape))
    return np.asarray(m_um * 1e-6 / (count * total * np.diff(surface_below)))


def density_per_m(sizes: Sizes, diameter_m: ArrayLike, *, by: Weight) -> Floats:
    """Density of the droplets, or of their mass, per metre of diameter, of any shape.

    Raises SprayError if all droplets have one diameter, or if their number is infinite.
    """
    d = np.asarray(diameter_m, dtype=float)
    power = _POWER[by]
    if isinstance(sizes, Monodisperse):
        raise SprayError("droplets of one diameter have no density")
    if isinstance(sizes, Histogram):
        edges, below = _running(sizes, power)
        number = np.append(np.array(sizes.number) / np.diff(edges), 0.0)
        cell = np.searchsorted(edges, d * 1e6, side="right") - 1
        inside = (cell >= 0) & (cell < len(number) - 1)
        return (
            np.asarray(np.where(inside, number[cell], 0.0) * (d * 1e6) ** power / below[-1]) * 1e6
        )
    with np.errstate(divide="ignore", under="ignore"):
        if isinstance(sizes, LogNormal):
            spread = np.log(sizes.sigma)
            middle = np.log(sizes.median_um * 1e-6) + power * spread**2
            deviation = (np.log(d) - middle) / spread
            density = np.exp(-0.5 * deviation**2) / (d * spread * np.sqrt(2 * np.pi))
            return np.asarray(np.where(d > 0, density, 0.0))
        m_um, n, p, shape = _weighted(sizes, by)
        relative = d / (m_um * 1e-6)
        form = relative ** (p + power) * np.exp(-(relative**n))
        return np.asarray(form * n / (m_um * 1e-6 * np.exp(scipy.special.gammaln(shape))))


def _gamma(sizes: NukiyamaTanasawa | RosinRammler) -> tuple[float, float, float]:
    """Parameters m in um, n and p of Eq. (5)."""
    if isinstance(sizes, RosinRammler):
        return sizes.d_um, sizes.q, sizes.q - 4
    return sizes.m_um, sizes.n, sizes.p


def _weighted(
    sizes: NukiyamaTanasawa | RosinRammler, by: Weight
) -> tuple[float, float, float, float]:
    """Parameters, and shape of the Gamma distribution; SprayError if the number is infinite."""
    m_um, n, p = _gamma(sizes)
    shape = (p + 1 + _POWER[by]) / n
    if shape <= 0:
        raise SprayError(f"Rosin-Rammler with q = {n:g}: the number of droplets is infinite")
    return m_um, n, p, shape


def _running(sizes: Histogram, power: int) -> tuple[Floats, Floats]:
    """Edges in um, and the sum of number * D^power below each."""
    edges = np.array(sizes.edges_um)
    number = np.array(sizes.number) / np.diff(edges)
    parts = number * np.diff(edges ** (power + 1)) / (power + 1)
    return edges, np.concatenate([[0.0], np.cumsum(parts)])
