"""Ends of rays: cold absorbers in front of hot gas, against the closed form.

A transmission of 1e-5 of a source that is 1e4 times as bright as the absorber counts. Nothing
scatters, so that nothing else is wrong and no audit sees it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from tests.verify.blocks import grid_scene

EDGE_M = 0.1
BEHIND = 3.0  # optical depth of the hot gas


def scene(folder: Path, *, cold_K: float, hot_K: float, depth: float, **transport: Any) -> Any:
    """A layer of droplets, of this depth, in front of one of gas, both two voxels of a grid."""
    layer = np.broadcast_to(np.arange(4)[None, :, None] < 2, (4, 4, 4))
    arrays = {
        "droplet_absorption_per_m": np.where(layer, depth, 0.0) / (EDGE_M / 2),
        "droplet_scattering_per_m": 0.0,
        "droplet_temperature_K": cold_K,
        "vapour_absorption_per_m": np.where(layer, 0.0, BEHIND) / (EDGE_M / 2),
        "vapour_temperature_K": hot_K,
    }
    data = grid_scene(
        folder,
        arrays,
        size_m=(EDGE_M,) * 3,
        camera={"model": "orthographic", "pixels": [4, 4], "field_m": [0.05, 0.05]},
        background={"radius_m": 0.09, "temperatures_K": [350.0, 450.0]},
        walls={"temperature_K": 300.0},
        domain={"edge_m": 0.2},
        transport=transport,
    )
    return cldit.Scene.from_dict(data)


@pytest.mark.parametrize(
    ("cold_K", "hot_K", "depth"),
    [
        (350.0, 900.0, 9.5),  # 3.2 K too cold by a cutoff of 1e-4 ...
        (350.0, 2200.0, 9.5),  # 37 K ...
        (350.0, 2200.0, 25.0),
        (1.0, 5000.0, 15.0),  # and of all light, to which the cold layer adds none
    ],
)
def test_hot_gas_behind_a_cold_layer(
    tmp_path: Path, cold_K: float, hot_K: float, depth: float
) -> None:
    """Light beyond the end of a ray changes T_app by 1 % of what is asked for at most."""
    asked_K = 1.0
    given = scene(tmp_path, cold_K=cold_K, hot_K=hot_K, depth=depth, accuracy_K=asked_K)
    filter_um = scene_filter(given)
    cold, hot = (float(band_radiance(T, filter_um=filter_um)) for T in (cold_K, hot_K))
    light = -np.expm1(-depth) * cold - np.exp(-depth) * np.expm1(-BEHIND) * hot
    whole = light / -np.expm1(-depth - BEHIND)
    expected_K = float(temperature_of_radiance(whole, filter_um=filter_um))
    run = cldit.simulate(given)
    error_K = run.maps.apparent_temperature_K.astype(float) - expected_K
    # Single precision: weights to 1e-6 of themselves, of which T_app changes by T / 12 at most
    # (Wien at 3.4 um and 350 K), or T / 1 at 5000 K; maps have 24 bits, too.
    assert np.abs(error_K).max() < 0.01 * asked_K + 1e-6 * expected_K


def test_a_cutoff_that_is_given_is_kept_and_stated(tmp_path: Path) -> None:
    """The error of 3.2 K is stated where the scene asks for it."""
    less = {"cutoff": 1e-4, "accuracy_K": 1.0}
    run = cldit.simulate(scene(tmp_path, cold_K=350.0, hot_K=900.0, depth=9.5, **less))
    whole = cldit.simulate(scene(tmp_path, cold_K=350.0, hot_K=900.0, depth=9.5))
    apart_K = np.abs(run.maps.apparent_temperature_K - whole.maps.apparent_temperature_K).max()
    assert apart_K > 3.0
    assert run.errors is not None and run.errors.total_K == pytest.approx(apart_K, rel=0.3)
