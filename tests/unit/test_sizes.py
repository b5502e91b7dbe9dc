"""Droplet sizes against the paper's table, against numerical integration, and strata."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from cldit.scene.schema import Monodisperse, NukiyamaTanasawa
from cldit.spray.sizes import Sizes, mean_diameter_m, quantile_m, strata_m

# The paper's Fig. 4. It rounds n: with 1.28822 and 0.86420 all its entries come out.
PAPER: list[tuple[Sizes, float, float]] = [
    (NukiyamaTanasawa(m_um=1.5, n=1.0, p=3.0), 6.00, 9.00),
    (NukiyamaTanasawa(m_um=3.21, n=1.28822, p=2.0), 5.97, 9.00),
    (NukiyamaTanasawa(m_um=1.5, n=0.86420, p=1.0), 4.11, 9.00),
    (Monodisperse(diameter_um=9.0), 9.00, 9.00),
]
# As printed, the second and third row give these.
PRINTED: list[tuple[Sizes, float, float]] = [
    (NukiyamaTanasawa(m_um=3.21, n=1.29, p=2.0), 5.958, 8.976),
    (NukiyamaTanasawa(m_um=1.5, n=0.864, p=1.0), 4.107, 9.006),
]


def _density(sizes: NukiyamaTanasawa, d_um: float) -> float:
    """Eq. (5) without its constant."""
    return float(d_um**sizes.p * np.exp(-((d_um / sizes.m_um) ** sizes.n)))


@pytest.mark.parametrize(("sizes", "d10", "d32"), PAPER)
def test_paper_table(sizes: Sizes, d10: float, d32: float) -> None:
    assert mean_diameter_m(sizes, 1, 0) * 1e6 == pytest.approx(d10, abs=0.005)
    assert mean_diameter_m(sizes, 3, 2) * 1e6 == pytest.approx(d32, abs=0.005)


@pytest.mark.parametrize(("sizes", "d10", "d32"), PRINTED)
def test_paper_table_as_printed(sizes: Sizes, d10: float, d32: float) -> None:
    assert mean_diameter_m(sizes, 1, 0) * 1e6 == pytest.approx(d10, abs=0.0005)
    assert mean_diameter_m(sizes, 3, 2) * 1e6 == pytest.approx(d32, abs=0.0005)


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


@pytest.mark.parametrize("by", ["number", "mass"])
@pytest.mark.parametrize("sizes", [row[0] for row in PAPER[:3]])
def test_quantiles_by_quadrature(sizes: NukiyamaTanasawa, by: str) -> None:
    weight = 0 if by == "number" else 3
    share = np.array([0.01, 0.3, 0.5, 0.99])
    found = quantile_m(sizes, share, by=by) * 1e6  # type: ignore[arg-type]

    def mass(d: float) -> float:
        return d**weight * _density(sizes, d)

    whole = quad(mass, 0, 400, limit=400, points=[5, 20, 60])[0]
    below = [quad(mass, 0, d, limit=400)[0] / whole for d in found]
    assert below == pytest.approx(share, rel=1e-6)


@pytest.mark.parametrize("sizes", [row[0] for row in PAPER])
@pytest.mark.parametrize("count", [1, 4, 64])
def test_strata_keep_the_sauter_diameter(sizes: Sizes, count: int) -> None:
    """Equal masses of 1/D surface each; each lies within its own share of the mass."""
    strata = strata_m(sizes, count)
    assert strata.shape == (count,)
    assert 1 / np.mean(1 / strata) == pytest.approx(mean_diameter_m(sizes, 3, 2), rel=1e-10)
    edges = quantile_m(sizes, np.linspace(0, 1, count + 1), by="mass")
    assert np.all(strata >= edges[:-1]) and np.all(strata <= edges[1:])
