"""Drawn pixels of a large image, and sums over them, which are those of the image."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.accuracy.drawn_pixels import DrawnPixels, all_are_traced

ROWS, COLUMNS = 330, 360


def drawn_of(seed: int) -> tuple[DrawnPixels, np.ndarray, np.ndarray]:
    """A plume of a tenth of the picture, before a background of nine tenths of it."""
    before = np.ones((ROWS, COLUMNS), bool)
    before[:, : COLUMNS // 10] = False
    seen = np.zeros((ROWS, COLUMNS), bool)
    seen[: ROWS // 3, 180:288] = True
    coarse = seen[::5, ::4].astype(float)
    return DrawnPixels.of(before, coarse, seed=seed), before, seen


def test_most_are_where_the_medium_is_seen() -> None:
    """A tenth of the chance is for all; what lies beside the plume is likely as well."""
    drawn, before, seen = drawn_of(1)
    count = len(drawn.sample.pixels)
    assert count == pytest.approx(10_000, abs=1)
    row, column = drawn.places
    assert before[row, column].all()
    assert np.count_nonzero(seen[row, column]) > 0.8 * count
    chance = np.full((ROWS, COLUMNS), np.nan)
    chance[row, column] = drawn.chance[0]
    elsewhere = np.isfinite(chance) & (row.max() > 0)
    elsewhere[: ROWS // 3 + 10] = False
    # Of a thousand for all before the background, the lower two thirds have some 650.
    assert 500 < np.count_nonzero(elsewhere) < 800


def test_sums_have_no_bias() -> None:
    """Of a disc across the plume's edge, whose pixels have unlike chances; over 50 draws."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    disc = ((y - 112) ** 2 + (x - 200) ** 2 < 30**2).astype(np.float32)
    found = []
    for seed in range(50):
        drawn, _, _ = drawn_of(seed)
        found.append(float(np.sum(drawn.pick(disc) / drawn.chance)))
    error = float(np.std(found, ddof=1)) / len(found) ** 0.5
    assert float(np.mean(found)) == pytest.approx(disc.sum(), abs=4 * error)
    assert error < 0.03 * disc.sum()


def test_an_image_of_them_and_back() -> None:
    drawn, _, _ = drawn_of(2)
    image = np.random.default_rng(1).random((ROWS, COLUMNS), np.float32)
    back = drawn.spread(drawn.pick(image))
    known = np.isfinite(back)
    assert np.count_nonzero(known) == len(drawn.sample.pixels)
    np.testing.assert_array_equal(back[known], image[known])


def test_where_nothing_is_likely_all_are_alike() -> None:
    before = np.ones((ROWS, COLUMNS), bool)
    drawn = DrawnPixels.of(before, np.zeros((10, 10)), seed=1)
    assert np.ptp(drawn.sample.chance) == 0 and len(drawn.sample.pixels) >= 9_999


def test_small_pictures_are_traced_whole() -> None:
    assert all_are_traced((300, 300)) and not all_are_traced((301, 300))
