"""Mie efficiencies as cldit uses them: published values, limits, conservation of energy.

Published: W. J. Wiscombe, NCAR/TN-140+STR (1979), the test cases of MIEV0 (MVTstNew), which use
m = n - ik.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import miepython
import mpmath
import numpy as np
import pytest

from cldit.errors import DropletError
from cldit.optics import mie
from cldit.optics.droplets import DropletTable, droplet_table

WAVELENGTH_UM = 3.4

# n, k, x, Q_ext, Q_sca, g Q_sca: all of MIEV0's cases but those of a perfect conductor.
MIEV0 = [
    (0.75, 0.0, 0.099, 7.417859e-06, 7.417859e-06, 1.074279e-08),
    (0.75, 0.0, 0.101, 8.033542e-06, 8.033542e-06, 1.211000e-08),
    (0.75, 0.0, 10.0, 2.232265, 2.232265, 2.001164),
    (0.75, 0.0, 1000.0, 1.997908, 1.997908, 1.688121),
    (1.33, 1e-5, 1.0, 9.395198e-02, 9.392330e-02, 1.733048e-02),
    (1.33, 1e-5, 100.0, 2.101321, 2.096594, 1.821854),
    (1.33, 1e-5, 10000.0, 2.004089, 1.723857, 1.564987),
    (1.5, 1.0, 0.055, 1.014910e-01, 1.131687e-05, 5.558541e-09),
    (1.5, 1.0, 0.056, 1.033467e-01, 1.216311e-05, 6.193255e-09),
    (1.5, 1.0, 1.0, 2.336321, 6.634538e-01, 1.274736e-01),
    (1.5, 1.0, 100.0, 2.097502, 1.283697, 1.091466),
    (1.5, 1.0, 10000.0, 2.004368, 1.236574, 1.046525),
    (10.0, 10.0, 1.0, 2.532993, 2.049405, -2.267961e-01),
    (10.0, 10.0, 100.0, 2.071124, 1.836785, 1.021648),
    (10.0, 10.0, 10000.0, 2.005914, 1.795393, 9.842238e-01),
]


@cache
def _table(n: float, k: float) -> DropletTable:
    return droplet_table(wavelength_um=WAVELENGTH_UM, n=n, k=k, cache=None)


def _efficiencies(n: float, k: float, x: float) -> np.ndarray:
    table = _table(n, k)
    return np.array(table.efficiencies(x * WAVELENGTH_UM * 1e-6 / np.pi))


@pytest.mark.parametrize(("n", "k", "x", "q_ext", "q_sca", "g_q_sca"), MIEV0)
def test_miev0(n: float, k: float, x: float, q_ext: float, q_sca: float, g_q_sca: float) -> None:
    """Seven digits are printed; single precision made the last of them."""
    found = mie.efficiencies(n=n, k=k, x=x)
    assert found.extinction[0] == pytest.approx(q_ext, rel=1e-6)
    assert found.scattering[0] == pytest.approx(q_sca, rel=1e-6)
    assert (found.asymmetry * found.scattering)[0] == pytest.approx(g_q_sca, rel=2e-6)


@pytest.mark.parametrize("n", [0.75, 1.338, 5.0])
def test_energy_is_conserved_without_absorption(n: float) -> None:
    """Extinction from the forward amplitude, scattering from all of them: equal to 1e-12."""
    for x in (0.3, 5.0, 80.0, 1000.0):
        size = np.array([x])
        a, b = mie.coefficients(n=n, k=0.0, x=size)
        double = 2 * np.arange(1, len(a) + 1)[:, None] + 1
        out = np.sum(double * (a + b).real)
        scattered = np.sum(double * (abs(a) ** 2 + abs(b) ** 2))
        assert scattered == pytest.approx(out, rel=1e-12)


@pytest.mark.parametrize(
    ("n", "k"), [(1.338, 0.0341), (1.338, 10.0), (0.1, 5.0), (1.0001, 1e-5), (10.0, 0.3)]
)
def test_miepython_agrees(n: float, k: float) -> None:
    """Two codes, all sizes: 1e-6 covers miepython's shorter small-sphere series, |m| x < 0.1."""
    x = np.concatenate([np.geomspace(1e-4, 150, 60), [2000.0]])
    found = mie.efficiencies(n=n, k=k, x=x)
    q_ext, q_sca, _, g = miepython.efficiencies_mx(complex(n, -k), x)
    near = x * np.hypot(n, k) < 0.1
    for part, rel in ((near, 1e-6), (~near, 1e-8)):
        assert found.extinction[part] == pytest.approx(q_ext[part], rel=rel)
        assert found.scattering[part] == pytest.approx(q_sca[part], rel=rel)
        assert found.asymmetry[part] == pytest.approx(g[part], rel=10 * rel, abs=1e-12)


def test_a_new_table_is_checked_by_miepython(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scattering off by 1e-5 is found."""
    solve = mie.efficiencies

    def wrong(**options: float) -> mie.Efficiencies:
        right = solve(**options)
        return replace(right, scattering=right.scattering * (1 + 1e-5))

    monkeypatch.setattr(mie, "efficiencies", wrong)
    with pytest.raises(DropletError, match=r"Q_sca at x = .* by miepython"):
        droplet_table(wavelength_um=WAVELENGTH_UM, n=1.338, k=0.0341, cache=None)


@pytest.mark.parametrize(
    ("n", "k", "x"),
    [
        (1.338, 0.0341, 9.0),
        (1.5, 10.0, 40.0),
        (3.0, 1e-6, 0.07),
        (1.338, 1e-5, 1e-4),
        (1.338, 1e-12, 0.03),
        (1.0001, 1e-6, 0.1),
        (1.338, 1e-9, 0.99),
        (1.338, 1e-14, 30.0),
        (1.5, 1e-5, 100.0),
    ],
)
def test_series_in_fifty_digits(n: float, k: float, x: float) -> None:
    """The textbook formula (Bohren and Huffman, Eq. 4.53) with mpmath's Bessel functions."""
    with mpmath.workdps(50):
        m, size = mpmath.mpc(n, k), mpmath.mpf(x)

        def psi(order: int, z: object) -> mpmath.mpf:
            return mpmath.sqrt(mpmath.pi * z / 2) * mpmath.besselj(order + mpmath.mpf(1) / 2, z)

        def xi(order: int, z: object) -> mpmath.mpc:
            return mpmath.sqrt(mpmath.pi * z / 2) * mpmath.hankel1(order + mpmath.mpf(1) / 2, z)

        q_ext = q_sca = mpmath.mpf(0)
        for order in range(1, mie.terms(x) + 6):
            inside, outside, wave = psi(order, m * size), psi(order, size), xi(order, size)
            d_inside = psi(order - 1, m * size) - order * inside / (m * size)
            d_outside = psi(order - 1, size) - order * outside / size
            d_wave = xi(order - 1, size) - order * wave / size
            top = m * inside * d_outside - outside * d_inside
            a = top / (m * inside * d_wave - wave * d_inside)
            top = inside * d_outside - m * outside * d_inside
            b = top / (inside * d_wave - m * wave * d_inside)
            q_ext += 2 / size**2 * (2 * order + 1) * (a + b).real
            q_sca += 2 / size**2 * (2 * order + 1) * (abs(a) ** 2 + abs(b) ** 2)
        found = mie.efficiencies(n=n, k=k, x=x)
        # Terms that are left out are 1e-9 of the first.
        assert found.extinction[0] == pytest.approx(float(q_ext), rel=1e-8)
        assert found.scattering[0] == pytest.approx(float(q_sca), rel=1e-8)
        assert found.absorption[0] == pytest.approx(float(q_ext - q_sca), rel=1e-8)


@pytest.mark.parametrize(
    ("k", "x"),
    [
        (1e-4, 120.0),
        (1e-5, 45.0),
        (1e-5, 120.0),
        (1e-6, 20.0),
        pytest.param(1e-6, 120.0, marks=pytest.mark.slow),
        pytest.param(1e-7, 45.0, marks=pytest.mark.slow),
    ],
)
def test_means_count_resonances_that_samples_miss(k: float, x: float) -> None:
    """Mean Q_abs over +-1 % from samples 4e-5 apart, against samples that resolve every resonance:
    two to the half width k / n. Single spheres at the coarse samples are off by up to 10 %.

    1e-3 is what the tables state: the sum over a Lorentzian 1.5 samples half wide is right to
    2 exp(-3 pi) = 2e-4, and its wings reach past the ends.
    """

    def mean(spacing: float, seen: float) -> float:
        count = int(0.01 / spacing)
        offset = spacing * np.arange(-count, count + 1)
        weight = 1 - np.abs(offset) / 0.01
        solved = mie.efficiencies(n=1.338, k=k, x=x * np.exp(offset), spacing=seen)
        return float(weight @ solved.absorption / weight.sum())

    exact = mean(0.5 * k / 1.338, 0.0)
    assert mean(4.1e-5, 4.1e-5) == pytest.approx(exact, rel=1e-3)
    if k == 1e-5 and x == 45.0:
        assert abs(mean(4.1e-5, 0.0) / exact - 1) > 2e-3


@pytest.mark.parametrize(("n", "k", "x"), [(1.3, -1e-9, 1.0), (1.3, 10.1, 1.0), (0.0, 1.0, 1.0)])
def test_impossible_index_is_refused(n: float, k: float, x: float) -> None:
    with pytest.raises(DropletError, match="allowed: "):
        mie.efficiencies(n=n, k=k, x=x)


@pytest.mark.parametrize("x", [9e-5, 1.1e4, 0.0, -1.0, float("nan"), float("inf")])
def test_sizes_outside_are_refused(x: float) -> None:
    with pytest.raises(DropletError, match=r"outside 0\.0001\.\.10000"):
        mie.efficiencies(n=1.338, k=0.0341, x=[1.0, x])


@pytest.mark.parametrize(("n", "k"), [(1.338, 0.0341), (1.5, 1.0), (1.7, 0.2)])
def test_large_droplets_extinguish_twice_their_area(n: float, k: float) -> None:
    """Edge diffraction: Q_ext = 2 + 1.9924 x^(-2/3) (Nussenzveig, Wiscombe 1980), then x^-4/3."""
    x = np.array([150.0, 300.0, 450.0])
    table = _table(n, k)
    q_ext, _, _ = table.efficiencies(x * WAVELENGTH_UM * 1e-6 / np.pi)
    assert q_ext == pytest.approx(2 + 1.9924 * x ** (-2 / 3), abs=4e-3)
    assert abs(q_ext[-1] - 2) < 0.04


def test_rayleigh_limit() -> None:
    """Q_abs = -4 x Im K and Q_sca = 8/3 x^4 |K|^2, K = (m^2 - 1)/(m^2 + 2); next order x^2."""
    m2 = complex(1.338, -0.0341) ** 2
    contrast = (m2 - 1) / (m2 + 2)
    for x in (1e-4, 0.01, 0.03):
        q_ext, q_sca, _ = _efficiencies(1.338, 0.0341, x)
        assert q_ext - q_sca == pytest.approx(-4 * x * contrast.imag, rel=2 * x * x + 3e-4)
        assert q_sca == pytest.approx(8 / 3 * x**4 * abs(contrast) ** 2, rel=2 * x * x + 3e-4)
