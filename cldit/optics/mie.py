"""Mie's solution for many spheres of one refractive index m = n - ik at once.

After Bohren and Huffman (1983), chapter 4: logarithmic derivatives of the inner field by downward
recurrence, Riccati-Bessel functions of the outer one upwards, N = x + 4.05 x^(1/3) + 2 terms
(Wiscombe 1980). Where x < 1, psi comes from the downward recurrence too, and a_n from differences
of logarithmic derivatives: no digits are lost down to x = 1e-4. Absorption is summed by itself.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.arrays import Floats, Mask
from cldit.errors import DropletError

Complex = NDArray[np.complex128]

SIZE_PARAMETERS = (1e-4, 1e4)
LARGEST_K = 10.0
_SMALL = 1.0  # of x
_BYTES = 64e6  # of the coefficients of one part of the sizes


@dataclass(frozen=True)
class Efficiencies:
    """Q_ext, Q_sca, Q_abs and g, each (S,); Q_abs is exactly 0 where k is."""

    extinction: Floats
    scattering: Floats
    absorption: Floats
    asymmetry: Floats


def terms(x: float) -> int:
    """Number of terms of the series for a sphere of size parameter `x`."""
    return int(x + 4.05 * np.cbrt(x) + 2) + 1


def check(*, n: float, k: float, x: ArrayLike) -> Floats:
    """Checks the arguments of Mie's solution; returns the size parameters, flattened to (S,)."""
    sizes = np.atleast_1d(np.asarray(x, dtype=float)).ravel()
    if not (0.1 <= n <= 10 and 0 <= k <= LARGEST_K):
        raise DropletError(
            f"Mie: n = {n:g}, k = {k:g}; allowed: n in 0.1..10 and k in 0..{LARGEST_K:g} "
            "(m = n - ik)"
        )
    low, high = SIZE_PARAMETERS
    inside = (sizes >= low * (1 - 1e-9)) & (sizes <= high * (1 + 1e-9))
    if not np.all(inside):
        raise DropletError(
            f"Mie: size parameter {sizes[~inside][0]:g} is outside {low:g}..{high:g}"
        )
    return sizes


def efficiencies(*, n: float, k: float, x: ArrayLike, spacing: float = 0.0) -> Efficiencies:
    """Efficiencies of spheres, flattened to (S,).

    They agree with the series in 50 digits to 1e-8, Q_abs too, which is not a difference.

    Args:
        n, k: refractive index n - ik.
        x: size parameters pi d / wavelength, any shape.
        spacing: of ln x, for means over sizes: resonances narrower than this are widened, with
            their absorption preserved (`_narrow`). 0: single spheres.
    """
    sizes = check(n=n, k=k, x=x)
    out = np.zeros((4, sizes.size))
    order = np.argsort(sizes, kind="stable")
    begin = 0
    while begin < order.size:
        part = order[begin : begin + _chunk(sizes[order[begin:]])]
        series = _solve(n=n, k=k, x=sizes[part], spacing=spacing)
        out[:, part] = _sums(series, sizes[part])
        begin += part.size
    if k == 0:
        out[0] = out[1]
    return Efficiencies(*out)


def _chunk(rising: Floats) -> int:
    """Number of rising sizes to solve together, with similar numbers of terms and in memory."""
    limit = max(1, int(_BYTES / (64 * terms(float(rising[0])))))
    alike = int(np.searchsorted(rising, 1.15 * rising[0] + 2, side="right"))
    if rising[0] < _SMALL:
        alike = int(np.searchsorted(rising, _SMALL))
    return max(1, min(limit, alike))


_Series = tuple[Complex, Complex, Floats]
"""Coefficients a_n, b_n and Re a - |a|^2 + Re b - |b|^2 by order and sphere, (terms, S)."""


def _sums(series: _Series, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    a, b, absorbed = series
    order = np.arange(1, len(a) + 1)[:, None]
    front = 2.0 / (x * x)
    double = 2 * order + 1
    q_ext = front * np.sum(double * (a + b).real, axis=0)
    q_sca = front * np.sum(double * (np.abs(a) ** 2 + np.abs(b) ** 2), axis=0)
    q_abs = front * np.sum(double * absorbed, axis=0)
    n = order[:-1]
    next_to = (a[:-1] * a[1:].conj() + b[:-1] * b[1:].conj()).real * (n * (n + 2) / (n + 1))
    same = (a * b.conj()).real * (double / (order * (order + 1)))
    turned = 2 * front * (np.sum(next_to, axis=0) + np.sum(same, axis=0))
    g = np.divide(
        turned, q_sca, out=np.zeros_like(q_sca), where=q_sca > 0
    )  # n = 1 scatters nothing
    return q_ext, q_sca, q_abs, g


def coefficients(*, n: float, k: float, x: Floats) -> tuple[Complex, Complex]:
    """Mie's coefficients a_n and b_n, (terms, S) each, 0 beyond the terms that a sphere needs.

    The size parameters `x` (S,) should be similar.
    """
    return _solve(n=n, k=k, x=x)[:2]


def _inner(m: complex, x: Floats, highest: int) -> Complex:
    """Logarithmic derivatives psi_n'(z) / psi_n(z) at z = m x, orders 0 .. last, (last + 1, S)."""
    z = np.asarray(m * x, np.complex128)
    largest = float(np.abs(z).max())
    start = max(highest, int(largest + 4.05 * np.cbrt(largest))) + 20
    inner = np.zeros((highest + 1, z.size), dtype=complex)
    d = np.zeros(z.size, dtype=complex)
    for order in range(start, 0, -1):
        ratio = order / z
        d = ratio - 1.0 / (d + ratio)
        if order - 1 <= highest:
            inner[order - 1] = d
    return inner


def _solve(*, n: float, k: float, x: Floats, spacing: float = 0.0) -> _Series:
    m = complex(n, k)  # the sign of k is that of exp(-i w t); only moduli and real parts are used
    # 1.5 spacings of half a width: a sum over a Lorentzian is then right to 2 exp(-3 pi).
    broad = complex(n, max(k, 1.5 * spacing * n))
    count = np.array([terms(size) for size in x])
    highest = int(count.max())
    inner = _inner(m, x, highest)
    broader = _inner(broad, x, highest) if 0 < k < broad.imag else None
    outer = _inner(1.0 + 0j, x, highest).real if x.max() < _SMALL else None
    a = np.zeros((highest, x.size), dtype=complex)
    b = np.zeros_like(a)
    absorbed = np.zeros((highest, x.size))
    psi_before, psi = np.cos(x), np.sin(x)
    chi_before, chi = -np.sin(x), np.cos(x)
    for order in range(1, highest + 1):
        factor = (2 * order - 1) / x
        if outer is None:
            psi_before, psi = psi, factor * psi - psi_before
        else:
            psi_before, psi = psi, psi / (outer[order] + order / x)
        with np.errstate(over="ignore", invalid="ignore"):  # of orders that a sphere does not need
            chi_before, chi = chi, factor * chi - chi_before
            xi, xi_before = psi - 1j * chi, psi_before - 1j * chi_before
            for power, series in ((-1, a), (1, b)):
                matched = inner[order] * m**power
                wave = (matched + order / x) * xi - xi_before
                if outer is None:
                    series[order - 1] = ((matched + order / x) * psi - psi_before) / wave
                else:
                    series[order - 1] = psi * (matched - outer[order]) / wave
                if k > 0:
                    lost = _absorbed(matched, wave)
                    if broader is not None:
                        matched = broader[order] * broad**power
                        broad_wave = (matched + order / x) * xi - xi_before
                        narrow, ratio = _narrow(order, x, xi, xi_before, m, broad.imag, power)
                        lost = np.where(narrow, _absorbed(matched, broad_wave) * ratio, lost)
                    absorbed[order - 1] += lost
    beyond = np.arange(1, highest + 1)[:, None] > count
    for values in (a, b, absorbed):
        values[beyond] = 0.0
    return a, b, absorbed


def _absorbed(matched: Complex, wave: Complex) -> Floats:
    """Re a - |a|^2 without cancellation: -Im(m^power D) / |wave|^2, by the Wronskian."""
    return np.asarray(-matched.imag / (wave.real**2 + wave.imag**2))


def _narrow(
    order: int,
    x: Floats,
    xi: Complex,
    xi_before: Complex,
    m: complex,
    larger_k: float,
    power: int,
) -> tuple[Mask, Floats]:
    """True for spheres x (S,) at narrow resonances, and the ratio of their areas to those of a
    larger k.

    xi: the outgoing wave in this order, and in the order before. The logarithmic derivative D of
    the field inside is matched with a power of the index m, -1 for the electric and 1 for the
    magnetic field: m^power D = xi' / xi at resonance. The area of a resonance of widths f by
    radiation and k e by absorption is proportional to k e f / (f + k e); f = |Im xi' / xi| =
    1 / |xi|^2 and e = -d(m^power D) / dm, by the Riccati equation D' = n (n + 1) / z^2 - 1 - D^2.
    """
    n, k = m.real, m.imag
    radiated = 1.0 / np.abs(xi) ** 2
    d = (xi_before / xi).real - order / x
    d = d * n**-power
    slope = order * (order + 1) / (n * x) ** 2 - 1.0 - d * d
    taken = -(power * d + n * x * slope) * n ** (power - 1)
    narrow = (order < n * x) & (taken > 0) & (radiated + k * taken < larger_k * taken)
    return narrow, (k / larger_k) * (radiated + larger_k * taken) / (radiated + k * taken)


def intensity(a: Complex, b: Complex, cosine: Floats) -> Floats:
    """(|S1|^2 + |S2|^2) / 2 of unpolarised light, (M, S).

    a, b: (terms, S) coefficients. cosine: (M,) of the scattering angle.
    """
    count = len(a)
    order = np.arange(1, count + 1)
    pi = np.zeros((count, cosine.size))
    tau = np.zeros_like(pi)
    older, old = np.zeros_like(cosine), np.ones_like(cosine)
    for n in order:
        pi[n - 1] = old
        tau[n - 1] = n * cosine * old - (n + 1) * older
        older, old = old, ((2 * n + 1) * cosine * old - (n + 1) * older) / n
    factor = ((2 * order + 1) / (order * (order + 1)))[:, None]
    a, b = factor * a, factor * b
    plus = np.abs((pi + tau).T @ (a + b)) ** 2
    minus = np.abs((pi - tau).T @ (a - b)) ** 2
    return np.asarray(0.25 * (plus + minus))
