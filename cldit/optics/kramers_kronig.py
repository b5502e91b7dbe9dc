"""The real part of a refractive index from its imaginary part (Kramers 1927, Kronig 1926).

    n(v) = n(v0) + (2 / pi) P int v' k(v') [1 / (v'^2 - v^2) - 1 / (v'^2 - v0^2)] dv'

with v the wavenumber: the relation with one subtraction, at an anchor (v0, n(v0)) that is known.
The difference of the two kernels falls as v'^-3, so k beyond the table has little influence near
the anchor. Between its points k is taken linear in v, and each piece is integrated in closed form.
"""

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import OpticsError

_ROWS = 256  # wavenumbers at a time, which bounds the memory


def n_from_k(wavelength_um: ArrayLike, k: ArrayLike, *, anchor: tuple[float, float]) -> Floats:
    """n at the wavelengths of a table of k.

    Beyond the table's ends k falls to 0 within one step. The error is that of taking k linear:
    second order in the step, 1e-3 of the largest k with 20 points in the full width of a band.

    Args:
        wavelength_um: (N,), rising or falling, at least 3.
        k: (N,), not negative; m = n - ik.
        anchor: (wavelength_um, n) within the table.

    Returns:
        (N,) n.
    """
    wavelength = np.asarray(wavelength_um, dtype=float)
    absorbed = np.asarray(k, dtype=float)
    if wavelength.ndim != 1 or wavelength.shape != absorbed.shape or wavelength.size < 3:
        raise OpticsError(
            f"Kramers-Kronig: {wavelength.shape} wavelengths and {absorbed.shape} k; allowed: "
            "equal numbers, 3 or more"
        )
    if not np.all(np.isfinite(absorbed)) or absorbed.min() < 0:
        bad = absorbed[~(absorbed >= 0) | ~np.isfinite(absorbed)][0]
        raise OpticsError(f"Kramers-Kronig: k = {bad:g}; allowed: finite numbers from 0")
    step = np.diff(wavelength)
    in_order = np.all(step > 0) or np.all(step < 0)
    if not (np.all(np.isfinite(wavelength)) and wavelength.min() > 0 and in_order):
        raise OpticsError("Kramers-Kronig: wavelengths must be positive, and rise or fall")
    where, n_there = anchor
    if not (wavelength.min() <= where <= wavelength.max() and np.isfinite(n_there)):
        raise OpticsError(
            f"Kramers-Kronig: the anchor at {where:g} um is outside the table, "
            f"{wavelength.min():g}..{wavelength.max():g} um"
        )
    number = 1.0 / wavelength
    order = np.argsort(number)
    at = np.append(number, 1.0 / where)
    shift = _integral(number[order], absorbed[order], at)
    return np.asarray(n_there + (2.0 / np.pi) * (shift[:-1] - shift[-1]))


def _integral(number: Floats, k: Floats, at: Floats) -> Floats:
    """P int v k(v) / (v^2 - a^2) dv for every a in `at`, with k = c + d v between the points.

    With v (c + d v) / (v^2 - a^2) = d + (c v + d a^2) / (v^2 - a^2) a piece gives
    d v + (c + d a) / 2 ln|v - a| + (c - d a) / 2 ln(v + a). At a point of the table the
    logarithms of both neighbours have the same factor, k / 2, and cancel.
    """
    start = max(2 * number[0] - number[1], 0.5 * number[0])
    v = np.concatenate([[start], number, [2 * number[-1] - number[-2]]])
    height = np.concatenate([[0.0], k, [0.0]])
    slope = np.diff(height) / np.diff(v)
    level = height[:-1] - slope * v[:-1]
    total = np.full(at.shape, np.sum(np.diff(height)))
    for begin in range(0, at.size, _ROWS):
        a = at[begin : begin + _ROWS, None]
        distance = np.abs(v - a)
        differences = np.diff(np.log(np.where(distance > 1e-14 * a, distance, 1.0)))
        sums = np.diff(np.log(v + a))
        pieces = (level + slope * a) * differences + (level - slope * a) * sums
        total[begin : begin + _ROWS] += 0.5 * np.sum(pieces, axis=1)
    return total
