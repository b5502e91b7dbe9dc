"""Phase functions: tables, Mie's of droplets, and how many classes of size a spray gets."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.errors import OpticsError
from cldit.optics.droplets import droplet_table
from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import PhaseError, ScatteringTable, SizeClasses
from cldit.transport.size_classes import (
    MOST_CLASSES,
    TOLERATED,
    _costs,
    _Groups,
    _partition,
    in_size_classes,
)
from tests.phase_tables import henyey_greenstein

OPTICS = {"wavelength_um": 3.4, "n": 1.338, "k": 0.0341}
COUNT = 4000


@pytest.fixture(scope="module")
def place() -> Floats:
    return np.random.default_rng(1).normal(size=(COUNT, 3)) * [1e-3, 1e-3, 5e-3]


def classes_of(
    place: Floats, diameter: Floats, *, sampled: bool = True, tolerated: float = TOLERATED
) -> ScatteringTable:
    scattering = np.ones(COUNT)  # of each parcel
    bins = SizeBins.of(diameter, scattering, **OPTICS)
    return in_size_classes(
        bins.mean(),
        bins,
        position_m=place,
        diameter_m=diameter,
        scattering_m2=scattering,
        sampled=sampled,
        tolerated=tolerated,
    )


def test_one_class_where_sizes_are_alike_everywhere(place: Floats) -> None:
    """Any sizes at any place: chance alone sets 125 groups of 32 apart, and is taken off. It is
    half the distance of both sizes, 0.5, over the root of 32; its square is known to 2 / 125 of 1,
    so that what is left is below 0.02 or so."""
    diameter = np.random.default_rng(3).choice([2e-6, 18e-6], COUNT)
    assert classes_of(place, diameter, tolerated=0.03).classes is None
    by_chance = classes_of(place, diameter, tolerated=0.03, sampled=False).classes
    assert by_chance is not None


def test_two_sizes_in_two_places(place: Floats) -> None:
    """Two classes, exact; as one they are apart by no less than their asymmetries are."""
    diameter = np.where(place[:, 2] > 0, 18e-6, 2e-6)
    phase = classes_of(place, diameter)
    assert phase.classes is not None
    assert len(phase.tables) == 2 and phase.classes.unresolved < 1e-9
    np.testing.assert_array_equal(phase.classes.number(diameter), diameter > 1e-5)
    small, large = (table.asymmetry for table in phase.tables)
    share = np.mean(diameter > 1e-5)
    spread = (large - small) * np.sqrt(share * (1 - share))  # RMS of g about its mean
    # A few groups hold both sizes; bins are 16 of 1024 wide.
    assert classes_of(place, diameter, tolerated=0.9 * spread).classes is not None
    assert classes_of(place, diameter, tolerated=3 * spread).classes is None


def test_as_few_classes_as_are_tolerated(place: Floats) -> None:
    """Sizes that rise along the spray: more classes leave less."""
    diameter = 2e-6 * np.exp(2.5 * (np.argsort(np.argsort(place[:, 2])) / COUNT))
    counts, left = [], []
    for tolerated in (0.05, 0.02, 0.01):
        phase = classes_of(place, diameter, tolerated=tolerated)
        assert phase.classes is not None
        counts.append(len(phase.tables))
        left.append(phase.classes.unresolved)
        assert left[-1] <= tolerated or counts[-1] == MOST_CLASSES
    assert counts == sorted(counts) and left == sorted(left, reverse=True)
    assert 2 <= counts[0] < counts[-1]


def test_partition_against_all_partitions() -> None:
    rng = np.random.default_rng(4)
    vectors, share = rng.normal(size=(9, 3)), rng.random(9)
    costs = _costs(vectors, share)

    def scatter(first: int, end: int) -> float:
        middle = np.average(vectors[first:end], axis=0, weights=share[first:end])
        return float(share[first:end] @ np.sum((vectors[first:end] - middle) ** 2, axis=1))

    for classes in (1, 2, 3, 4):
        least = min(
            sum(scatter(*pair) for pair in zip((0, *cut), (*cut, 9), strict=True))
            for cut in combinations(range(1, 9), classes - 1)
        )
        starts = _partition(costs, classes)
        found = sum(scatter(*pair) for pair in zip(starts, [*starts[1:], 9], strict=True))
        assert starts[0] == 0 and len(starts) == classes
        assert found == pytest.approx(least)


def test_distance_of_a_sample_is_that_of_the_spray() -> None:
    """Two sizes of equal weight, with a share that rises from 0.5 - s to 0.5 + s along a line: its
    RMS from the mean is s / sqrt(3), times the distance of the sizes. Of 100 sprays the mean square
    is right within three standard errors, without chance's 1 / 32 of 1 / 4."""
    rng = np.random.default_rng(5)
    apart, squares = np.array([[0.0], [1.0]]), []
    for _ in range(100):
        along = rng.random(3200)
        number = (rng.random(3200) < 0.5 + 0.2 * (2 * along - 1)).astype(np.intp)
        position = np.stack([along, 0 * along, 0 * along], axis=1)
        groups = _Groups.of(position, np.ones(3200), number, bins=2, sampled=True)
        middle = np.mean(number)
        squares.append(groups.distance(apart - middle) ** 2)
    error = float(np.std(squares, ddof=1)) / 10
    assert float(np.mean(squares)) == pytest.approx(0.2**2 / 3, abs=3 * error)
    assert error < 1 / 32 / 4 / 10


@pytest.mark.parametrize("g", [-0.7, 0.0, 1e-7, 0.3, 0.8, 0.95])
def test_henyey_greenstein_moments_are_powers_of_g(g: float) -> None:
    """Exact but for the bins of 3 mrad: second order in their width, times (l + 1)^2 / 12."""
    moments = henyey_greenstein(g).moments(12)
    degrees = np.arange(12)
    assert moments == pytest.approx(g**degrees, abs=144 * (np.pi / 1024) ** 2 / 12)
    assert moments[0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("g", [-1.0, 1.0, float("nan")])
def test_impossible_asymmetry_is_refused(g: float) -> None:
    with pytest.raises(OpticsError, match=r"outside -1\.\.1"):
        henyey_greenstein(g)


def test_classes_by_diameter() -> None:
    one, other = henyey_greenstein(0.2), henyey_greenstein(0.9)
    classes = SizeClasses(np.array([5e-6]), (one, other), 0.0)
    np.testing.assert_array_equal(classes.number(np.array([1e-6, 5e-6, 2e-5])), [0, 1, 1])
    mean = henyey_greenstein(0.5)
    assert mean.tables == (mean,)
    assert replace(mean, classes=classes).tables == (one, other)
    with pytest.raises(PhaseError, match="1 phase functions for 0 bounds"):
        SizeClasses(np.zeros(0), (one,), 0.0)


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
