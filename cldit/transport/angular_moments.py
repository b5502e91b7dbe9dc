"""Moments of light over the directions that it comes from, to the second order, and of sources.

Of light I: its mean J; F = mean of I d; Q = mean of I (d d - 1/3), of which xx, yy, xy, xz and yz
tell the rest, for Q is symmetric and has no trace. Scattering by a phase function of Legendre
moments 1, g, h sends back along d

    albedo (J + 3 g F . d + 15/2 h d . Q d).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOMENTS = 9  # the mean, three of the first order, five of the second


def discrete_to_moment(unit: Floats) -> Floats:
    """(8, N): by what light from unit vectors (N, 3) counts in each moment but the mean."""
    x, y, z = unit.T
    return np.stack([x, y, z, x * x - 1 / 3, y * y - 1 / 3, x * y, x * z, y * z])


def moment_to_discrete(unit: Floats) -> Floats:
    """(8, N): by what each moment of a source counts, seen along unit vectors (N, 3)."""
    x, y, z = unit.T
    return np.stack([x, y, z, x * x - z * z, y * y - z * z, x * y, x * z, y * z])


def phase_coefficients(first: float, second: float) -> Floats:
    """(8,): what a source has of each of the light's, by the phase function's g and h."""
    return np.array([*[3 * first] * 3, *[7.5 * second] * 2, *[15 * second] * 3])
