"""Allocation of rays to pixels."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from cldit.transport.final_gather.gather import Gather
from cldit.transport.ray_choice import MOST_ACROSS, allocated, as_shared, evaluated
from cldit.transport.sobol import net
from cldit.transport.tuning import Tuning
from cldit.transport.view import dilated

ONE = np.ones(1000, np.int64)


def left(square: np.ndarray, across: np.ndarray) -> float:
    """Sum of squares by these rays, which falls with their number as n^-3/2."""
    return float(np.sum(square / across**3.0))


@pytest.mark.parametrize("allowed", [1e-2, 0.1, 0.5])
def test_sum_of_squares_at_little_cost(allowed: float) -> None:
    """Against the best allocation of any number of rays: rounding to powers of four costs no more
    than a factor of four."""
    square = np.random.default_rng(1).random(1000) ** 8
    square /= square.sum()
    across = allocated(square, ONE, allowed=allowed)
    assert left(square, across) <= allowed
    assert set(np.unique(across)) <= {1, 2, 4, 8, 16}
    assert np.all(np.diff(across[np.argsort(square)]) >= 0)
    many = square**0.4  # n in proportion to e^(4/5), so that the sum of squares is what is allowed
    many *= (np.sum(square / many**1.5) / allowed) ** (2 / 3)
    assert np.sum(across**2) <= 4 * np.sum(np.maximum(many, 1.0))


def test_what_pixels_have_is_kept() -> None:
    square = np.full(1000, 1e-3)
    have = np.where(np.arange(1000) < 100, 8, 1)
    across = allocated(square, have, allowed=0.5)
    assert np.all(across >= have) and left(square * have**3.0, across) <= 0.5
    assert np.array_equal(allocated(square, have, allowed=2.0), have)


@pytest.mark.parametrize("count", [1, 4, 16, 64, 256, 1024])
def test_rays_of_a_pixel_are_a_net(count: int) -> None:
    """One point in each row, in each column, and in each rectangle of the same area."""
    whole = net(count)
    points = whole[:, :2]
    for rows in 2 ** np.arange(int(np.log2(count)) + 1):
        place = np.floor(points * [rows, count // rows])
        assert len(np.unique(place, axis=0)) == count
    np.testing.assert_allclose(whole.mean(axis=0), 0.5)


def test_the_number_of_rays_has_an_end() -> None:
    square = np.ones(40_000)
    across = allocated(square, np.ones(len(square), np.int64), allowed=1e-9)
    assert across.max() <= MOST_ACROSS
    assert 0.2 < np.sum(across**2) / (4 * len(square) + 1e6) <= 1.0
    spread = np.geomspace(1.0, 1e6, len(square))
    across = allocated(spread, np.ones(len(square), np.int64), allowed=1e-9)
    assert 0.8 < np.sum(across**2) / (4 * len(square) + 1e6) <= 1.0
    nothing = allocated(np.zeros(5), np.ones(5, np.int64), allowed=0.0)
    assert np.all(nothing == 1)


def test_few_rays_stand_for_the_exact_share_of_the_background() -> None:
    """A uniform medium transmits 0.3: weights by any rays give those by the exact shares."""
    seen, exact = np.array([[0.625], [0.375]]), np.array([[0.579], [0.421]])
    few, true = (np.concatenate([0.3 * shares, [[0.5]]]) for shares in (seen, exact))
    assert as_shared(few, seen, exact) == pytest.approx(true)
    # DIT subtracts the wall's light without the spray, and divides by the background's share.
    wanted = [0.3, (0.3 - 1.0) * 0.421 / 0.579, 0.5 / 0.579]
    assert evaluated(few, seen, exact)[:, 0] == pytest.approx(wanted)


def test_rays_through_thick_cells_share_the_paths_of_an_image() -> None:
    """A thousand rays took half of the scatterings that an image may have."""
    gather = object.__new__(Gather)
    gather._settings = cast(Any, SimpleNamespace(tuning=Tuning(path_segments=1e6)))
    gather._spent, gather._rays, gather.short = 5e5, 1000, ""
    assert gather.affords(1000) and not gather.short
    assert not gather.affords(1001) and "1e+06 scatterings" in gather.short


@pytest.mark.parametrize("pixels", [0, 1, 3, 40])
def test_squares_about_pixels_are_those_of_a_filter(pixels: int) -> None:
    chosen = np.random.default_rng(4).random((9, 30)) < 0.03
    expected = maximum_filter(chosen, 2 * pixels + 1)
    assert 0 < chosen.sum() <= expected.sum()
    np.testing.assert_array_equal(dilated(chosen, pixels), expected)
