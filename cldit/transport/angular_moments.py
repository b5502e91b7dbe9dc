"""Angular moments of radiance and of sources, to the second order.

They serve the moment source (stage 2 of `trace_source`) and the sweeps after it. The radiance I has
the mean J, F = mean of I d, and Q = mean of I (d d - 1/3). Q is symmetric and has no trace, so xx,
yy, xy, xz and yz suffice. A phase function of Legendre moments 1, g, h gives the source along d
(Modest, Radiative Heat Transfer, ch. 16: spherical harmonics)

    albedo (J + 3 g F . d + 15/2 h d . Q d).
"""

import numpy as np

from cldit.arrays import Floats

MOMENTS = 9  # the mean, three of the first order, five of the second


def discrete_to_moment(unit: Floats) -> Floats:
    """Weights (8, N) of radiance from unit vectors (N, 3) in each moment but the mean."""
    x, y, z = unit.T
    return np.stack([x, y, z, x * x - 1 / 3, y * y - 1 / 3, x * y, x * z, y * z])


def phase_coefficients(moment_1: Floats, moment_2: Floats) -> Floats:
    """Ratios (8, N) of a source's moments to the radiance's, over the albedo.

    `moment_1` and `moment_2` (N,) are the Legendre moments g and h of the phase function.
    """
    return np.array([*[3 * moment_1] * 3, *[7.5 * moment_2] * 2, *[15 * moment_2] * 3])
