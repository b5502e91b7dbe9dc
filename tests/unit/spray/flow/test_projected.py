"""The projected liquid's image, of which only the rows of the penetration are computed."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.spray.flow import projected
from cldit.spray.flow.projected import PROJECTED_m, projected_reach_m


def test_rows_at_a_time_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spots lie across blocks of rows; each row has the same sum in any block, to rounding."""
    random = np.random.default_rng(4)
    position = random.normal(0, 4e-3, (2000, 3)) - [0.0, 0.0, 20e-3]
    volume = 10 ** random.uniform(-14, -11, 2000)
    whole = []
    for rows in (1, 7, 1000):
        monkeypatch.setattr(projected, "_ROWS", rows)
        whole.append(projected_reach_m(position, volume))
    assert whole[0][0] > 20e-3  # rows above, which are not computed, have more liquid
    np.testing.assert_allclose(whole[1], whole[0], rtol=1e-12)
    np.testing.assert_allclose(whole[2], whole[0], rtol=1e-12)


def test_spots_are_painted_in_full() -> None:
    """Sums of the image against one spot after the other, where spots lie across its border."""
    random = np.random.default_rng(5)
    aside, deep = random.uniform(0, 20, (2, 50))
    width, amount = random.uniform(0.5, 3, 50), random.uniform(0, 0.1 * PROJECTED_m, 50)
    image = np.zeros((20, 20))
    pixel = np.arange(20)
    for x, y, wide, whole in zip(aside, deep, width, amount, strict=True):
        sides = []
        for at in (x, y):
            side = np.exp(-0.5 * ((pixel + 0.5 - at) / wide) ** 2)
            inside = (pixel >= np.floor(at - 3 * wide)) & (pixel <= np.floor(at + 3 * wide))
            side[~inside] = 0.0
            sides.append(side / side.sum())
        image += whole * np.outer(*sides)
    found = projected._tops(aside, deep, width, amount, (20, 20))
    np.testing.assert_allclose(found, image.max(axis=0), rtol=1e-12)
