"""Phase functions: normalised, giving g, with the right limits and means."""

from __future__ import annotations

from pathlib import Path

import miepython
import numpy as np
import pytest

from cldit.errors import DropletError
from cldit.optics import mie
from cldit.optics.droplets import droplet_table
from cldit.optics.phase import PhaseFunction, PhaseTable, phase_table

N, K = 1.338, 0.0341


def phase_function(*, x: float, n: float, k: float) -> PhaseFunction:
    """Exact phase function of one sphere of size parameter `x` and index n - ik."""
    cosine, weights = np.polynomial.legendre.leggauss(max(mie.terms(x) + 1, 181))
    intensity = mie.intensity(*mie.coefficients(n=n, k=k, x=np.array([x])), cosine)[:, 0]
    q_sca = float(mie.efficiencies(n=n, k=k, x=x).scattering[0])
    return PhaseFunction(cosine, weights, intensity / (np.pi * x * x * q_sca))


@pytest.fixture(scope="module")
def table() -> PhaseTable:
    return phase_table(wavelength_um=3.4, n=N, k=K, cache=None, largest_m=60e-6)


@pytest.mark.parametrize("x", [1e-3, 0.5, 8.0, 90.0, 400.0])
@pytest.mark.parametrize("k", [0.0, K, 5.0])
def test_normalised_and_giving_g(x: float, k: float) -> None:
    """Both come from the amplitudes; the efficiencies from sums over a_n, b_n. The series' cut
    leaves 1e-9; a small sphere is solved by another expansion, good to x^2 in g."""
    phase = phase_function(x=x, n=N, k=k)
    assert np.sum(2 * np.pi * phase.weights * phase.density_per_sr) == pytest.approx(1, abs=2e-9)
    g = mie.efficiencies(n=N, k=k, x=x).asymmetry[0]
    assert phase.asymmetry == pytest.approx(g, rel=1e-6, abs=1e-9)
    assert phase.moments(2) == pytest.approx([1, phase.asymmetry], abs=2e-9)


def test_angles_against_miepython() -> None:
    phase = phase_function(x=8.3, n=N, k=K)
    other = miepython.i_unpolarized(complex(N, -K), 8.3, phase.cosine, norm="one")
    assert phase.density_per_sr == pytest.approx(other, rel=1e-7)


def test_rayleigh_limit() -> None:
    """3 / (16 pi) (1 + cos^2)."""
    phase = phase_function(x=1e-3, n=N, k=K)
    expected = 3 / (16 * np.pi) * (1 + phase.cosine**2)
    assert phase.density_per_sr == pytest.approx(expected, rel=1e-5)


def test_table_of_one_size_is_the_mean_over_its_neighbourhood(table: PhaseTable) -> None:
    """An entry is a hat of one step, 3.7 %, to both sides; here by direct summation."""
    place = 120
    d = table.diameter_m[place]
    step = np.log(table.diameter_m[1] / table.diameter_m[0])
    offset = np.linspace(-1, 1, 161)
    weight = 1 - np.abs(offset)
    x = np.pi * d * np.exp(step * offset) / 3.4e-6
    total = mie.intensity(*mie.coefficients(n=N, k=K, x=x), table.cosine) @ weight
    total /= 2 * np.pi * total @ table.weights
    found = table.mean(d, 1.0).density_per_sr
    assert found == pytest.approx(total, rel=0.01)


def test_mean_over_a_distribution(table: PhaseTable) -> None:
    """g of a broad distribution is the mean of g weighted by scattering, within 5e-4."""
    d = np.linspace(2e-6, 30e-6, 4000)
    number = np.exp(-(((d - 9e-6) / 5e-6) ** 2))
    phase = table.mean(d, number)
    x = np.pi * d / 3.4e-6
    solved = mie.efficiencies(n=N, k=K, x=x)
    g = np.average(solved.asymmetry, weights=number * solved.scattering * d**2)
    assert phase.asymmetry == pytest.approx(g, abs=5e-4)
    assert phase.moments(1)[0] == pytest.approx(1, abs=1e-8)
    assert np.all(phase.density_per_sr > 0)


def test_below_the_table_small_droplets_count_by_the_sixth_power(table: PhaseTable) -> None:
    """A million droplets of a tenth of the size scatter as one."""
    small = table.diameter_m[0]
    mixed = table.mean([0.1 * small, 20e-6], [1e6, 1e-12])
    single = table.mean([small, 20e-6], [1.0, 1e-12])
    assert mixed.density_per_sr == pytest.approx(single.density_per_sr, rel=1e-9)


@pytest.mark.parametrize("d", [0.0, -1e-6, 61e-6, float("nan")])
def test_diameters_outside_are_refused(table: PhaseTable, d: float) -> None:
    with pytest.raises(DropletError, match="must be above 0"):
        table.mean([9e-6, d], 1.0)


def test_what_cannot_scatter_is_refused(table: PhaseTable) -> None:
    with pytest.raises(DropletError, match="nothing to average"):
        table.mean(9e-6, 0.0)
    with pytest.raises(DropletError, match="scatter nothing"):
        phase_table(wavelength_um=3.4, n=1.0, k=0.0, cache=None)
    with pytest.raises(DropletError, match="outside"):
        phase_table(wavelength_um=0.2, n=N, k=K, cache=None, largest_m=1e-2)
    with pytest.raises(DropletError, match="largest diameter"):
        phase_table(wavelength_um=3.4, n=N, k=K, cache=None, largest_m=0.0)


def test_cached(table: PhaseTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"wavelength_um": 3.4, "n": N, "k": K, "largest_m": 60e-6}
    phase_table(**given, cache=tmp_path)
    monkeypatch.setattr(mie, "intensity", lambda *_: pytest.fail("built anew"))
    kept = phase_table(**given, cache=tmp_path)
    assert np.array_equal(kept.density_per_sr, table.density_per_sr)


def test_mean_g_is_that_of_the_efficiency_table(table: PhaseTable) -> None:
    """Two tables, one physics: 1 % at single diameters, whose ripple the hats take out."""
    sizes = np.geomspace(2e-7, 5e-5, 30)
    g = droplet_table(wavelength_um=3.4, n=N, k=K, cache=None).efficiencies(sizes)[2]
    assert [table.mean(d, 1.0).asymmetry for d in sizes] == pytest.approx(g, abs=0.01)
