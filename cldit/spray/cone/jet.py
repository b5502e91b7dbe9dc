"""Quasi-steady jet of one plume: the momentum model of Naber and Siebers with a radial profile.

J. D. Naber and D. L. Siebers, SAE 960034: fuel leaves a hole with speed U and entrains gas inside a
cone, and momentum is conserved. With x+ = d sqrt(rho_f/rho_a) / (a tan(theta/2)) and s~ = s/x+ the
mean speed at a distance s is 2 U / (1 + sqrt(1 + 16 s~^2)), the mean fuel-to-gas mass ratio
2 / (sqrt(1 + 16 s~^2) - 1), and the travel time (x+/U) (s~/2 + s~/4 sqrt(1 + 16 s~^2) +
asinh(4 s~)/16).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gamma, sqrt

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats

# a: radius of the uniform jet of equal mass and momentum over that of the visible one, so that a
# plume of 22 degrees has the half width of jets, 0.085 s: 0.085 sqrt(2 / ln 2) / tan(11 degrees).
SPREADING = 0.743
NABER_SIEBERS = 0.66  # theirs, by which the tip of one plume is as they measured
SCHMIDT = 0.7  # turbulent Schmidt number of a round jet: its speed profile is the narrower


def profile(xi: ArrayLike) -> Floats:
    """Fuel-to-gas ratio across the plume over its value on the axis; xi = radius / edge, any shape.

    It is (1 - xi^1.5)^2, as of Musculus and Kattke (SAE 2009-01-1355).
    """
    inside = np.clip(np.asarray(xi, dtype=float), 0.0, 1.0)
    return np.asarray((1 - inside * np.sqrt(inside)) ** 2)


def _area_mean(exponent: float) -> float:
    """Mean of (1 - xi^1.5)^exponent over the disc: 4/3 Beta(4/3, exponent + 1)."""
    return 4 / 3 * gamma(4 / 3) * gamma(exponent + 1) / gamma(exponent + 7 / 3)


# Ratio of the axis to the mean of the flow: <u> / <u f> = 1.715 for f = profile and
# u = profile^(1/Sc). The factor b = 0.41 of Siebers for the liquid length gives 1.64.
CENTRE = _area_mean(2 / SCHMIDT) / _area_mean(2 / SCHMIDT + 2)
# Speed on the axis over the mean speed, which is that of the momentum: <u> / <u^2>.
_FASTEST = _area_mean(1 / SCHMIDT) / _area_mean(2 / SCHMIDT)
# Mean of xi^2, weighted with the profile.
MEAN_SQUARE = (1 / 4 - 2 / 5.5 + 1 / 7) / (1 / 2 - 2 / 3.5 + 1 / 5)


def speed_profile(xi: ArrayLike) -> Floats:
    """Speed across the plume over its mean speed, any shape."""
    return np.asarray(_FASTEST * profile(xi) ** (1 / SCHMIDT))


@dataclass(frozen=True)
class Jet:
    """Jet of one plume.

    rate_kg_s: fuel flow; speed_m_s: at the hole, or of the expanded gas; half_angle_rad: of the
    visible cone; densities of the fuel at the hole and of the surrounding gas; spreading: a.
    """

    rate_kg_s: float
    speed_m_s: float
    half_angle_rad: float
    fuel_kg_m3: float
    gas_kg_m3: float
    spreading: float = SPREADING

    @property
    def diameter_m(self) -> float:
        """Diameter that the flow would fill at that speed: sqrt(Ca) times that of the hole."""
        return sqrt(4 * self.rate_kg_s / (np.pi * self.fuel_kg_m3 * self.speed_m_s))

    @property
    def length_m(self) -> float:
        """Length scale x+."""
        ratio = sqrt(self.fuel_kg_m3 / self.gas_kg_m3)
        return self.diameter_m * ratio / (self.spreading * float(np.tan(self.half_angle_rad)))

    def _root(self, distance_m: ArrayLike) -> Floats:
        return np.sqrt(1 + 16 * (np.asarray(distance_m, dtype=float) / self.length_m) ** 2)

    def mean_speed_m_s(self, distance_m: ArrayLike) -> Floats:
        """Mean speed over the cross section at a distance, any shape."""
        return 2 * self.speed_m_s / (1 + self._root(distance_m))

    @property
    def momentum_N(self) -> float:
        """Momentum flux, the same at all distances."""
        return self.rate_kg_s * self.speed_m_s

    def gas_kg_s(self, distance_m: ArrayLike) -> Floats:
        """Flow of gas that the plume has taken in up to a distance, any shape."""
        return np.asarray(self.rate_kg_s * (self._root(distance_m) - 1) / 2)

    def axis_ratio(self, distance_m: ArrayLike) -> Floats:
        """Fuel-to-gas mass ratio on the axis, any shape; infinite at the hole."""
        s = np.asarray(distance_m, dtype=float) / self.length_m
        with np.errstate(divide="ignore"):
            # sqrt(1 + e) - 1 = e / (sqrt(1 + e) + 1), which does not cancel near the hole.
            return np.asarray(CENTRE * (self._root(distance_m) + 1) / (8 * s * s))

    def travel_s(self, distance_m: ArrayLike) -> Floats:
        """Travel time from the hole to a distance along the plume, any shape."""
        s = np.asarray(distance_m, dtype=float) / self.length_m
        path = s / 2 + s / 4 * self._root(distance_m) + np.arcsinh(4 * s) / 16
        return np.asarray(path * self.length_m / self.speed_m_s)

    def tip_m(self, time_s: float) -> float:
        """Distance of the first fuel: the inverse of `travel_s`, by bisection."""
        low, high = 0.0, max(self.speed_m_s * time_s, 1e-12)
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.travel_s(middle) < time_s else (low, middle)
        return 0.5 * (low + high)
