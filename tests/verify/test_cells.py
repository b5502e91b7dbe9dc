"""Cells that are the voxels of a grid: the picture is that of finer ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import cldit
from cldit.gpu.device import Device
from tests.verify.blocks import grid_scene

VOXEL_m = 3e-3
SHAPE = (20, 17, 13)  # no edge is a multiple of a brick's


def picture(folder: Path, device: Device, **domain: Any) -> cldit.Run:
    """Voxels of depth 0.02 to 0.5, the background right behind the last of them."""
    rng = np.random.default_rng(7)
    extinction, albedo = rng.uniform(0.02, 0.5, SHAPE) / VOXEL_m, rng.uniform(0.3, 0.95, SHAPE)
    arrays = {
        "droplet_scattering_per_m": extinction * albedo,
        "droplet_absorption_per_m": extinction * (1 - albedo),
        "droplet_temperature_K": 440.0,
    }
    behind = {"radius_m": 0.06, "centre_m": [0.0, SHAPE[1] * VOXEL_m / 2, 0.0]}
    scene = grid_scene(
        folder,
        arrays,
        size_m=[VOXEL_m * count for count in SHAPE],
        domain={"edge_m": 32 * VOXEL_m, **domain},
        camera={"pixels": [40, 40], "field_m": [0.07, 0.07], "target_m": [0.0, 0.0, 0.0]},
        background={**behind, "temperatures_K": [420.0, 480.0]},
        walls={"temperature_K": 430.0},
        transport={"phase": "isotropic", "accuracy_K": 0.2, "audit": False},
    )
    return cldit.simulate(cldit.Scene.from_dict(scene), device=device)


def test_voxels_are_enough(device: Device, tmp_path: Path) -> None:
    """Cells half as large are off by another 0.13 K at most (cells of depth 0.5 by themselves), and
    the ordinates of either picture by 0.2 K."""
    need = picture(tmp_path, device)
    corner_m = -np.array(SHAPE) * VOXEL_m / 2
    centre_m = [float(low) + 16 * VOXEL_m for low in corner_m]
    fine = picture(tmp_path, device, leaf_edge_m=0.51 * VOXEL_m, centre_m=centre_m)
    notes = [
        next(stage.note for stage in run.info.stages if stage.name == "octree")
        for run in (need, fine)
    ]
    assert notes[0].endswith("finest 3 mm") and notes[1].endswith("finest 1.5 mm")
    kelvin = [np.asarray(run.maps.apparent_temperature_K, float) for run in (need, fine)]
    seen = (need.maps.emissivity > 0.05) & np.isfinite(kelvin[0] + kelvin[1])
    assert np.count_nonzero(seen) > 500
    apart = (kelvin[0] - kelvin[1])[seen]
    assert np.sqrt(np.mean(apart**2)) < 0.13 + 0.2 * 2**0.5
    np.testing.assert_allclose(need.weights.background, fine.weights.background, atol=0.01)
