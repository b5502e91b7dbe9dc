"""A spray that is seen in another view: shift, rotation, scale and mirror are found."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.camera.alignment import align
from cldit.errors import EvaluationError

ROWS, COLUMNS = 96, 120


def spray(
    *, shift: tuple[float, float] = (0.0, 0.0), turn: float = 0.0, scale: float = 1.0, flip: int = 1
) -> NDArray[np.float64]:
    """Emissivity of five plumes, at the analytic place of each pixel in its own view."""
    row, column = np.indices((ROWS, COLUMNS), dtype=float)
    x, z = column - (COLUMNS - 1) / 2 - shift[0], (ROWS - 1) / 2 - row + shift[1]
    x, z = (
        (np.cos(turn) * x + np.sin(turn) * z) / scale * flip,
        (-np.sin(turn) * x + np.cos(turn) * z) / scale,
    )
    depth = np.zeros_like(x)
    for angle, reach in ((-0.9, 50.0), (-0.4, 62.0), (0.1, 58.0), (0.5, 45.0), (0.8, 55.0)):
        along = -(np.cos(angle) * (z - 38.0)) + np.sin(angle) * x
        across = np.cos(angle) * x + np.sin(angle) * (z - 38.0)
        width = 2.0 + 0.08 * np.maximum(along, 0.0)
        depth += (
            2.0
            * np.exp(-((across / width) ** 2) / 2)
            / ((1 + np.exp(-along)) * (1 + np.exp((along - reach) / 3)))
        )
    return np.asarray(1.0 - np.exp(-depth))


@pytest.mark.parametrize("flip", [1, -1])
def test_a_view_is_found(flip: int) -> None:
    """0.7 pixels, 0.5 degrees and 1 % to 0.1 pixels, 0.05 degrees and 0.1 %, with noise of 0.02."""
    rng = np.random.default_rng(1)
    turn = np.radians(0.5)
    seen = spray(shift=(0.7, -0.4), turn=turn, scale=1.01, flip=flip)
    pulls = []
    for _ in range(2):
        found = align(seen + 0.02 * rng.standard_normal(seen.shape), spray())
        off = found.values - [0.01, turn, 0.7, -0.4]
        assert found.mirrored == (flip < 0)
        assert np.all(np.abs(off) < [1e-3, np.radians(0.05), 0.1, 0.1]), found.text
        pulls.append(off / found.errors)
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2.0  # of 8 values


def test_a_far_view_is_found() -> None:
    found = align(spray(shift=(13.0, -9.0), turn=0.05, scale=0.95), spray())
    assert found.values == pytest.approx([-0.05, 0.05, 13.0, -9.0], abs=0.02)


def test_images_without_a_spray_or_of_another_are_refused() -> None:
    nothing = np.zeros((ROWS, COLUMNS))
    with pytest.raises(EvaluationError, match="less than 2 %"):
        align(spray(), nothing)
    noise = np.random.default_rng(2).random((ROWS, COLUMNS))
    with pytest.raises(EvaluationError, match="do not look alike"):
        align(spray(), noise)
