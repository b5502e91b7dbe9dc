"""Mie efficiencies as cldit uses them: published values, limits, conservation of energy.

Published: W. J. Wiscombe, NCAR/TN-140+STR (1979), the test cases of MIEV0 as its users quote them
(scottprahl/miepython, usask-arg/sasktran2, rtazaki1205/bhmie_rt), and the sample run of BHMIE in
Bohren and Huffman, Appendix A. All use m = n - ik.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cldit.optics.droplets import DropletTable, droplet_table

WAVELENGTH_UM = 3.4

# n, k, x, Q_ext, Q_sca, g; None where k = 1e-5 makes no difference worth a figure.
MIEV0 = [
    (1.33, 1e-5, 1.0, None, 0.093923, 0.184517),
    (1.33, 1e-5, 100.0, None, 2.096594, 0.868959),
    (1.5, 1.0, 0.055, 0.101491, 0.000011, 0.000491),
    (1.5, 1.0, 0.056, 0.1033467, 0.000012, 0.000509),
    (1.5, 1.0, 1.0, 2.336321, 0.663454, 0.192136),
    (1.5, 1.0, 100.0, 2.097502, 1.283697, 0.850252),
]


@cache
def _table(n: float, k: float) -> DropletTable:
    return droplet_table(wavelength_um=WAVELENGTH_UM, n=n, k=k, cache=None)


def _efficiencies(n: float, k: float, x: float) -> np.ndarray:
    table = _table(n, k)
    return np.array(table.efficiencies(x * WAVELENGTH_UM * 1e-6 / np.pi))


@pytest.mark.parametrize(("n", "k", "x", "q_ext", "q_sca", "g"), MIEV0)
def test_wiscombe(
    n: float, k: float, x: float, q_ext: float | None, q_sca: float, g: float
) -> None:
    """1e-5 for the table; almost without absorption, x = 100 is among resonances: 2 %."""
    within = 0.02 if k < 1e-3 and x > 10 else 2e-5
    found = _efficiencies(n, k, x)
    assert found[1:] == pytest.approx([q_sca, g], rel=within, abs=1e-6)
    if q_ext is not None:
        assert found[0] == pytest.approx(q_ext, rel=within)


def test_bohren_and_huffman() -> None:
    """A sphere of 0.525 um radius and n = 1.55 at 0.6328 um: Q_sca = 3.10543."""
    q_ext, q_sca, g = _efficiencies(1.55, 0.0, 2 * np.pi * 0.525 / 0.6328)
    assert q_sca == pytest.approx(3.10543, rel=2e-5)
    assert q_ext == q_sca
    assert g == pytest.approx(0.63314, rel=2e-5)


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


def test_absorption_takes_away_and_never_gives() -> None:
    d = np.geomspace(1e-8, 5e-4, 2000)
    for k in (0.0, 1e-6, 0.0341, 1.0):
        table = _table(1.338, k)
        c_abs, c_sca = table.cross_sections(d)
        assert np.all(c_sca > 0)
        assert np.all(c_abs == 0) if k == 0 else np.all(c_abs > 0)


def test_thin_droplets_absorb_by_volume() -> None:
    """Weak absorption, small phase: C_abs = alpha V with alpha = 4 pi k / wavelength, at n -> 1."""
    table = _table(1.0001, 1e-5)
    d = np.array([1e-6, 1e-5, 1e-4])
    volume = np.pi / 6 * d**3
    c_abs, _ = table.cross_sections(d)
    alpha = 4 * np.pi * 1e-5 / (WAVELENGTH_UM * 1e-6)
    assert c_abs / volume == pytest.approx(alpha, rel=alpha * 1e-4 + 1e-3)
