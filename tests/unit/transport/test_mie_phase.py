"""Mie's phase functions of droplets: means over sizes, bins of size, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.optics.droplets import droplet_table
from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import PhaseError

OPTICS = {"wavelength_um": 3.4, "n": 1.338, "k": 0.0341}


@pytest.mark.parametrize("diameter_m", [0.1e-6, 1e-6, 9e-6, 60e-6])
def test_asymmetry_of_one_droplet(diameter_m: float) -> None:
    """g of the table against g of the Mie series (another route: no angles in it)."""
    phase = SizeBins.of(np.array([diameter_m]), np.ones(1), **OPTICS).mean()
    table = droplet_table(**OPTICS, cache=None)
    assert phase.asymmetry == pytest.approx(float(table.efficiencies(diameter_m)[2]), abs=1e-4)
    assert phase.cumulative[0] == 0.0 and phase.cumulative[-1] == 1.0
    assert np.all(np.diff(phase.cumulative) >= 0)


def test_small_droplets_scatter_as_rayleigh() -> None:
    phase = SizeBins.of(np.array([0.02e-6]), np.ones(1), **OPTICS).mean()
    middle = (phase.cosine[1:] + phase.cosine[:-1]) / 2
    np.testing.assert_allclose(phase.density, 3 / 8 * (1 + middle**2), rtol=2e-3)


def test_mean_counts_droplets_by_what_they_scatter() -> None:
    """Mean g of 300 sizes, against the same mean of the Mie table's g."""
    table = droplet_table(**OPTICS, cache=None)
    d = np.geomspace(1e-6, 10e-6, 300)
    weight = table.cross_sections(d)[1] * np.exp(-d / 3e-6)
    expected = float(np.sum(weight * table.efficiencies(d)[2]) / weight.sum())
    # Sizes are pooled in 64 classes of 4 %: g changes by 1e-3 within one, of either sign.
    assert SizeBins.of(d, weight, **OPTICS).mean().asymmetry == pytest.approx(expected, abs=5e-4)


def test_nothing_that_scatters_is_refused() -> None:
    with pytest.raises(PhaseError, match="no droplet scatters"):
        SizeBins.of(np.array([1e-6]), np.zeros(1), **OPTICS).mean()


def test_parts_of_the_bins_make_the_whole() -> None:
    """Means over parts of the bins, weighted by what these scatter, are the mean of all."""
    rng = np.random.default_rng(2)
    d = 10e-6 * np.exp(0.5 * rng.normal(size=500))
    weight = d**2 * rng.random(500)
    bins = SizeBins.of(d, weight, **OPTICS)
    np.testing.assert_allclose(np.bincount(bins.number(d), weight, 64) / weight.sum(), bins.share)
    share = np.where(bins.solved, bins.share, 0.0)
    parts = sum(
        share[first:end].sum() * bins.mean(first, end).cumulative
        for first, end in ((0, 20), (20, 41), (41, 64))
    )
    np.testing.assert_allclose(parts / share.sum(), bins.mean().cumulative, atol=1e-12)
