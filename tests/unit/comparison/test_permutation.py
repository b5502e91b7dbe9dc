"""Permutation of members between two ensembles, against drawn ones."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import kstest

from cldit.comparison.members import permutation_p

_MEMBERS = 12


def _plume(rng: np.random.Generator, *, mass: float) -> np.ndarray:
    """Images (n, 24 x 24) of an edge that start and mass move, with noise of the pixels.

    A start 30 us off moves it by 1 pixel (1 sigma), a mass 5 % off warms it by 1 sigma.
    """
    row = np.indices((24, 24))[0]
    images = []
    for start, amount in rng.standard_normal((_MEMBERS, 2)):
        edge = 1.0 / (1.0 + np.exp(row - 12.0 - start))
        noise = gaussian_filter(rng.standard_normal((24, 24)), 1.0)
        images.append(30.0 * edge + (amount + mass / 0.05) * row / 12.0 + noise)
    return np.array(images).reshape(_MEMBERS, -1)


def test_p_is_uniform_without_a_change_and_small_with_one() -> None:
    """Of 100 trials 5 +- 2.2 have p below 0.05; mass + 10 % is 4.9 standard errors of its mean."""
    rng = np.random.default_rng(1)
    same = [permutation_p(_plume(rng, mass=0.0), _plume(rng, mass=0.0)) for _ in range(100)]
    assert kstest(same, "uniform").pvalue > 0.05
    assert np.sum(np.array(same) < 0.05) <= 11
    heavier = [permutation_p(_plume(rng, mass=0.0), _plume(rng, mass=0.1)) for _ in range(20)]
    assert np.sum(np.array(heavier) < 0.05) >= 18


def test_few_members_are_divided_in_all_ways() -> None:
    """Of 3 and 3 there are 20 divisions; the true one and its mirror image are the farthest."""
    rng = np.random.default_rng(2)
    one, other = rng.standard_normal((2, 3, 50))
    assert permutation_p(one, other + 10.0) == pytest.approx(2 / 20)
    assert permutation_p(one, one.copy()) == 1.0
    assert permutation_p(0.0 * one, 0.0 * other) == 1.0
