"""Mie's solution for many spheres of one refractive index m = n - ik at once.

After Bohren and Huffman (1983), chapter 4: logarithmic derivatives of the inner field by downward
recurrence, Riccati-Bessel functions of the outer one upwards, N = x + 4.05 x^(1/3) + 2 terms
(Wiscombe 1980). Small spheres (|m| x < 0.2) go to miepython, whose expansion keeps the digits that
the series loses; miepython is also what the tests compare with.
"""

from __future__ import annotations

from dataclasses import dataclass

import miepython
import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.errors import DropletError

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

SIZE_PARAMETERS = (1e-4, 1e4)
LARGEST_K = 10.0
_SMALL = 0.2  # of |m| x
_BYTES = 64e6  # of the coefficients of one part of the sizes


@dataclass(frozen=True)
class Efficiencies:
    """Q_ext, Q_sca, Q_abs and g, each (S,); Q_abs is exactly 0 where k is."""

    extinction: Floats
    scattering: Floats
    absorption: Floats
    asymmetry: Floats


def terms(x: float) -> int:
    """How many terms of the series a sphere needs."""
    return int(x + 4.05 * np.cbrt(x) + 2) + 1


def check(*, n: float, k: float, x: ArrayLike) -> Floats:
    """The size parameters as an array.

    Raises:
        DropletError: n is not in 0.1..10, k not in 0..10, or a size parameter not in 1e-4..1e4.
    """
    sizes = np.atleast_1d(np.asarray(x, dtype=float)).ravel()
    if not (0.1 <= n <= 10 and 0 <= k <= LARGEST_K):
        raise DropletError(
            f"Mie: n = {n:g}, k = {k:g}; allowed are n in 0.1..10 and k in 0..{LARGEST_K:g} "
            "(m = n - ik)"
        )
    low, high = SIZE_PARAMETERS
    inside = (sizes >= low * (1 - 1e-9)) & (sizes <= high * (1 + 1e-9))
    if not np.all(inside):
        raise DropletError(
            f"Mie: size parameter {sizes[~inside][0]:g} is outside {low:g}..{high:g}"
        )
    return sizes


def efficiencies(*, n: float, k: float, x: ArrayLike) -> Efficiencies:
    """Efficiencies of spheres of size parameter x = pi d / wavelength, flattened to (S,).

    Against miepython and MIEV0 to 1e-9; Q_abs to 1e-14 / Q_ext where absorption is weak.

    Raises:
        DropletError: as `check`.
    """
    sizes = check(n=n, k=k, x=x)
    out = np.zeros((4, sizes.size))
    small = sizes * np.hypot(n, k) < _SMALL
    if small.any():
        if k == 0 and n == 1:
            out[:, small] = 0.0
        else:
            q_ext, q_sca, _, g = miepython.efficiencies_mx(complex(n, -k), sizes[small])
            out[:, small] = q_ext, q_sca, np.maximum(q_ext - q_sca, 0.0), g
    order = np.argsort(sizes, kind="stable")
    order = order[~small[order]]
    begin = 0
    while begin < order.size:
        part = order[begin : begin + _chunk(sizes[order[begin:]])]
        out[:, part] = _sums(*coefficients(n=n, k=k, x=sizes[part]), sizes[part])
        begin += part.size
    if k == 0:
        out[2] = 0.0
        out[0] = out[1]
    return Efficiencies(*out)


def _chunk(rising: Floats) -> int:
    """How many of rising sizes to solve together: much the same number of terms, and memory."""
    most = max(1, int(_BYTES / (64 * terms(float(rising[0])))))
    alike = int(np.searchsorted(rising, 1.15 * rising[0] + 2, side="right"))
    return max(1, min(most, alike))


def _sums(a: Complex, b: Complex, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    order = np.arange(1, len(a) + 1)[:, None]
    front = 2.0 / (x * x)
    double = 2 * order + 1
    q_ext = front * np.sum(double * (a + b).real, axis=0)
    lost = np.abs(a) ** 2 + np.abs(b) ** 2
    q_sca = front * np.sum(double * lost, axis=0)
    # Re a - |a|^2 term by term, not the difference of two sums: fewer digits are lost.
    q_abs = front * np.sum(double * ((a + b).real - lost), axis=0)
    n = order[:-1]
    next_to = (a[:-1] * a[1:].conj() + b[:-1] * b[1:].conj()).real * (n * (n + 2) / (n + 1))
    same = (a * b.conj()).real * (double / (order * (order + 1)))
    turned = 2 * front * (np.sum(next_to, axis=0) + np.sum(same, axis=0))
    g = np.divide(
        turned, q_sca, out=np.zeros_like(q_sca), where=q_sca > 0
    )  # n = 1 scatters nothing
    return q_ext, q_sca, np.maximum(q_abs, 0.0), g


def coefficients(*, n: float, k: float, x: Floats) -> tuple[Complex, Complex]:
    """a_n and b_n, (terms, S), with zeros beyond what each sphere needs; x (S,) of like size."""
    m = complex(n, k)  # the sign of k is that of exp(-i w t); only moduli and real parts are used
    count = np.array([terms(size) for size in x])
    last = int(count.max())
    z = m * x
    start = max(last, int(np.abs(z).max() + 4.05 * np.cbrt(np.abs(z).max()))) + 20
    inner = np.zeros((last + 1, x.size), dtype=complex)
    d = np.zeros(x.size, dtype=complex)
    for order in range(start, 0, -1):
        ratio = order / z
        d = ratio - 1.0 / (d + ratio)
        if order - 1 <= last:
            inner[order - 1] = d
    a = np.zeros((last, x.size), dtype=complex)
    b = np.zeros_like(a)
    before, psi = np.cos(x), np.sin(x)
    chi_before, chi = -np.sin(x), np.cos(x)
    for order in range(1, last + 1):
        factor = (2 * order - 1) / x
        before, psi = psi, factor * psi - before
        chi_before, chi = chi, factor * chi - chi_before
        xi_before, xi = before - 1j * chi_before, psi - 1j * chi
        electric = inner[order] / m + order / x
        magnetic = inner[order] * m + order / x
        with np.errstate(over="ignore", invalid="ignore"):
            a[order - 1] = (electric * psi - before) / (electric * xi - xi_before)
            b[order - 1] = (magnetic * psi - before) / (magnetic * xi - xi_before)
    beyond = np.arange(1, last + 1)[:, None] > count
    a[beyond] = 0.0
    b[beyond] = 0.0
    return a, b


def intensity(a: Complex, b: Complex, cosine: Floats) -> Floats:
    """(|S1|^2 + |S2|^2) / 2 of unpolarised light, (M, S), at the cosines (M,) of the angle."""
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
