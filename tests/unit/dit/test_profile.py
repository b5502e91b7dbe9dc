"""Maps along a line from the injector."""

from __future__ import annotations

import csv
import io
from typing import Any

import numpy as np
import pytest

from cldit.dit.maps import Maps
from cldit.dit.profile import profile_of
from cldit.errors import EvaluationError

PIXEL_M = (1e-3, 1e-3)


def plume(angle_deg: float) -> Maps:
    """A straight plume from the top's middle, warmer further down: 400 K plus 1 K a millimetre."""
    rows, columns = 61, 121
    x = np.arange(columns) - 60.0
    down = np.arange(rows, dtype=np.float64)
    angle = np.radians(angle_deg)
    along = x[None, :] * np.sin(angle) + down[:, None] * np.cos(angle)
    off = x[None, :] * np.cos(angle) - down[:, None] * np.sin(angle)
    emissivity = np.exp(-((off / 3.0) ** 2)).astype(np.float32)
    warm = (400.0 + along).astype(np.float32)
    error = np.full(warm.shape, 0.25, np.float32)
    return Maps(emissivity, warm, error, error, np.zeros(warm.shape, np.uint8), error, error, error)


# The tip, (0, 0), is the middle of the top row.
WHERE: dict[str, Any] = {"pixel_m": PIXEL_M, "centre_m": (0.0, -30e-3)}


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, -45.0])
def test_it_follows_the_plume(angle_deg: float) -> None:
    profile = profile_of(plume(angle_deg), **WHERE)
    # Places are rounded to pixels: half a pixel's diagonal of distance, or of the plume's width.
    expected = 400.0 + 1e3 * profile.distance_m
    np.testing.assert_allclose(profile.apparent_temperature_K, expected, atol=0.5**0.5 + 0.01)
    assert profile.emissivity.min() > np.exp(-(((0.5**0.5 + 0.3) / 3.0) ** 2))
    assert np.hypot(profile.x_m, profile.z_m) == pytest.approx(profile.distance_m)
    assert 1e3 * profile.distance_m[-1] == pytest.approx(
        60 / np.cos(np.radians(angle_deg)), abs=1.5
    )


def test_a_line_of_ones_own() -> None:
    profile = profile_of(plume(0.0), **WHERE, start_m=(10e-3, -5e-3), angle_deg=90.0)
    assert profile.z_m == pytest.approx(np.full(profile.z_m.shape, -5e-3))
    np.testing.assert_allclose(profile.apparent_temperature_K, 405.0)
    assert profile.x_m[-1] == pytest.approx(60e-3)
    with pytest.raises(EvaluationError, match=r"x 100, z 0 mm is outside the image"):
        profile_of(plume(0.0), **WHERE, start_m=(0.1, 0.0))


def test_csv() -> None:
    error_K = np.full((61, 121), 2.0)
    profile = profile_of(plume(0.0), **WHERE, temperature_error_K=error_K)
    rows = list(csv.DictReader(io.StringIO(profile.csv())))
    assert len(rows) == profile.distance_m.size
    assert float(rows[3]["distance_m"]) == pytest.approx(3e-3)
    assert float(rows[3]["apparent_temperature_standard_error_K"]) == 2.0
