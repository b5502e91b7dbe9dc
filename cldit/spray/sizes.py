"""Droplet sizes: moments, quantiles and representative diameters in closed form.

Nukiyama-Tanasawa: f(D) = n D^p exp(-(D/m)^n) / (m^(p+1) Gamma((p+1)/n)), paper Eq. (5). With D
distributed so, (D/m)^n follows a Gamma distribution of shape (p+1)/n when droplets are counted,
and of shape (p+4)/n when their mass is.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammainc, gammaincinv, gammaln

from cldit.scene.schema import Monodisperse, NukiyamaTanasawa

Floats = NDArray[np.float64]
Sizes = NukiyamaTanasawa | Monodisperse
Weight = Literal["number", "mass"]


def mean_diameter_m(sizes: Sizes, high: int, low: int) -> float:
    """D_high,low = (<D^high> / <D^low>)^(1/(high - low)); D32 is paper Eq. (6), D10 the mean.

    Raises:
        ValueError: the two orders are equal.
    """
    if high == low:
        raise ValueError(f"D{high}{low}: the two orders must differ")
    if isinstance(sizes, Monodisperse):
        return sizes.diameter_um * 1e-6
    moments = gammaln((sizes.p + 1 + high) / sizes.n) - gammaln((sizes.p + 1 + low) / sizes.n)
    return float(sizes.m_um * 1e-6 * np.exp(moments / (high - low)))


def quantile_m(sizes: Sizes, share: ArrayLike, *, by: Weight) -> Floats:
    """Diameter below which a share (0..1) of the droplets, or of their mass, lies."""
    wanted = np.asarray(share, dtype=float)
    if isinstance(sizes, Monodisperse):
        return np.full(wanted.shape, sizes.diameter_um * 1e-6)
    return np.asarray(sizes.m_um * 1e-6 * gammaincinv(_shape(sizes, by), wanted) ** (1 / sizes.n))


def strata_m(sizes: Sizes, count: int) -> Floats:
    """`count` diameters, rising, one for each of `count` equal shares of the liquid's mass.

    Each has the surface per mass of its share, so droplets of these diameters, equal in mass,
    have the distribution's D32 exactly: (1/D32 is the mean of 1/D by mass.)
    """
    edges = np.linspace(0.0, 1.0, count + 1)
    if isinstance(sizes, Monodisperse):
        return np.full(count, sizes.diameter_um * 1e-6)
    shape = _shape(sizes, "mass")
    bounds = gammaincinv(shape, edges)
    below = gammainc(shape - 1 / sizes.n, bounds)
    whole = np.exp(gammaln(shape - 1 / sizes.n) - gammaln(shape))
    return np.asarray(sizes.m_um * 1e-6 / (count * whole * np.diff(below)))


def _shape(sizes: NukiyamaTanasawa, by: Weight) -> float:
    return (sizes.p + (1 if by == "number" else 4)) / sizes.n
