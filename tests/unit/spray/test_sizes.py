"""Droplet sizes against the paper's table, against numerical integration, and strata."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma

from cldit.errors import SprayError
from cldit.scene.sizes import Histogram, LogNormal, Monodisperse, NukiyamaTanasawa, RosinRammler
from cldit.spray.sizes import Sizes, density_per_m, mean_diameter_m, quantile_m, strata_m

# The paper's Fig. 4. It rounds n: with 1.28822 and 0.86420 all its entries come out.
PAPER: list[tuple[Sizes, float, float]] = [
    (NukiyamaTanasawa(m_um=1.5, n=1.0, p=3.0), 6.00, 9.00),
    (NukiyamaTanasawa(m_um=3.21, n=1.28822, p=2.0), 5.97, 9.00),
    (NukiyamaTanasawa(m_um=1.5, n=0.86420, p=1.0), 4.11, 9.00),
    (Monodisperse(diameter_um=9.0), 9.00, 9.00),
]
# Counted at a lens, say: one bin is empty, the first begins at 0.
COUNTED = Histogram(edges_um=(0.0, 4.0, 8.0, 10.0, 20.0), number=(50.0, 80.0, 0.0, 7.0))
OTHERS: list[Sizes] = [
    LogNormal(median_um=6.0, sigma=1.6),
    RosinRammler(d_um=10.0, q=5.0),
    RosinRammler(d_um=10.0, q=1.8),
    COUNTED,
]


def _density(sizes: NukiyamaTanasawa, d_um: float) -> float:
    """Eq. (5) without its constant."""
    return float(d_um**sizes.p * np.exp(-((d_um / sizes.m_um) ** sizes.n)))


@pytest.mark.parametrize(("sizes", "d10", "d32"), PAPER)
def test_paper_table(sizes: Sizes, d10: float, d32: float) -> None:
    assert mean_diameter_m(sizes, 1, 0) * 1e6 == pytest.approx(d10, abs=0.005)
    assert mean_diameter_m(sizes, 3, 2) * 1e6 == pytest.approx(d32, abs=0.005)


@pytest.mark.parametrize(("high", "low"), [(1, 0), (3, 2), (3, 0), (2, 1), (4, 3)])
def test_moments_by_quadrature(high: int, low: int) -> None:
    sizes = NukiyamaTanasawa(m_um=2.3, n=0.7, p=0.4)
    top, bottom = (
        quad(lambda d: d**power * _density(sizes, d), 0, np.inf, epsabs=0, limit=200)[0]  # noqa: B023
        for power in (high, low)
    )
    expected = (top / bottom) ** (1 / (high - low)) * 1e-6
    assert mean_diameter_m(sizes, high, low) == pytest.approx(expected, rel=1e-6)


def test_equal_orders_are_refused() -> None:
    with pytest.raises(ValueError, match="D22"):
        mean_diameter_m(Monodisperse(diameter_um=9.0), 2, 2)


@pytest.mark.parametrize("sizes", [*(row[0] for row in PAPER), *OTHERS])
@pytest.mark.parametrize("count", [1, 4, 64])
def test_strata_keep_the_sauter_diameter(sizes: Sizes, count: int) -> None:
    """Equal masses of 1/D surface each; each lies within its own share of the mass."""
    strata = strata_m(sizes, count)
    assert strata.shape == (count,)
    assert 1 / np.mean(1 / strata) == pytest.approx(mean_diameter_m(sizes, 3, 2), rel=1e-10)
    edges = quantile_m(sizes, np.linspace(0, 1, count + 1), by="mass")
    assert np.all(strata >= edges[:-1]) and np.all(strata <= edges[1:])


def _infinite(sizes: Sizes) -> bool:
    return isinstance(sizes, RosinRammler) and sizes.q <= 3


@pytest.mark.parametrize("sizes", [*(row[0] for row in PAPER[:3]), *OTHERS])
@pytest.mark.parametrize("by", ["number", "mass"])
def test_density_quantiles_and_moments_are_one_distribution(sizes: Sizes, by: str) -> None:
    """The density integrates to 1, to the quantiles' shares, and its moments are the closed ones.

    Trapezoids over 400 000 steps; the histogram's density jumps, which costs a step or two.
    """
    if by == "number" and _infinite(sizes):
        with pytest.raises(SprayError, match="infinite"):
            density_per_m(sizes, [1e-6], by="number")
        with pytest.raises(SprayError, match="infinite"):
            quantile_m(sizes, 0.5, by="number")
        return
    d = np.linspace(0, 300e-6, 400_001)[1:]
    density = density_per_m(sizes, d, by=by)  # type: ignore[arg-type]
    running = np.concatenate([[0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(d))])
    assert running[-1] == pytest.approx(1, abs=2e-3)
    share = np.array([0.02, 0.3, 0.5, 0.95])
    found = quantile_m(sizes, share, by=by)  # type: ignore[arg-type]
    assert np.interp(found, d, running) == pytest.approx(share, abs=2e-3)
    if by == "mass":  # 1 / D32 is the mean of 1 / D by mass
        inverse = np.trapezoid(density / d, d)
        assert 1 / inverse == pytest.approx(mean_diameter_m(sizes, 3, 2), rel=5e-3)
    else:
        mean = np.trapezoid(density * d, d)
        assert mean == pytest.approx(mean_diameter_m(sizes, 1, 0), rel=2e-3)


def test_published_moments() -> None:
    """Log-normal: D32 = median exp(2.5 s^2) (Hatch and Choate). Rosin-Rammler: D32 = d / G(1-1/q)
    and mass median d (ln 2)^(1/q) (Lefebvre)."""
    spread = np.log(1.6)
    assert mean_diameter_m(OTHERS[0], 3, 2) == pytest.approx(6e-6 * np.exp(2.5 * spread**2))
    assert mean_diameter_m(OTHERS[0], 1, 0) == pytest.approx(6e-6 * np.exp(0.5 * spread**2))
    assert mean_diameter_m(OTHERS[2], 3, 2) == pytest.approx(10e-6 / gamma(1 - 1 / 1.8))
    assert quantile_m(OTHERS[2], 0.5, by="mass") == pytest.approx(10e-6 * np.log(2) ** (1 / 1.8))


def test_histogram_by_hand() -> None:
    """10 droplets evenly in 2 to 4 um: <D> = 3, <D^2> = 28/3, <D^3> = 30."""
    sizes = Histogram(edges_um=(2.0, 4.0), number=(10.0,))
    assert mean_diameter_m(sizes, 1, 0) == pytest.approx(3e-6)
    assert mean_diameter_m(sizes, 3, 2) == pytest.approx(90 / 28 * 1e-6)
    assert quantile_m(sizes, [0.0, 0.25, 1.0], by="number") == pytest.approx([2e-6, 2.5e-6, 4e-6])


def test_moments_that_do_not_exist_are_refused() -> None:
    with pytest.raises(SprayError, match="needs q above 3"):
        mean_diameter_m(RosinRammler(d_um=10.0, q=3.0), 1, 0)
    with pytest.raises(SprayError, match="one diameter"):
        density_per_m(Monodisperse(diameter_um=9.0), 9e-6, by="mass")
