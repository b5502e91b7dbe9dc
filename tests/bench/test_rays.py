"""`cldit bench rays` on a small scene: more rays, less error, more pixels refined."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cldit.bench.rays import WAYS, bench_rays, table
from cldit.gpu.device import Device
from cldit.scene import parse_scene


def test_more_rays_come_nearer(device: Device, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    filled = rng.random((12, 12, 12)) < 0.3
    np.savez(
        tmp_path / "block.npz",
        origin_m=np.full(3, -0.03),
        spacing_m=np.full(3, 0.005),
        droplet_absorption_per_m=80.0 * filled,
        droplet_temperature_K=330.0 + 70.0 * rng.random(filled.shape),
    )
    scene = parse_scene(
        {
            "name": "block",
            "spray": {"model": "grid", "file": str(tmp_path / "block.npz")},
            "domain": {"leaf_edge_m": 0.006},
            "camera": {"pixels": 160},
        }
    )
    rows = {row.rays: row for row in bench_rays(scene, device)}
    assert tuple(rows) == WAYS
    assert rows[16].rms_K < rows[4].rms_K < rows[1].rms_K
    assert rows["adaptive"].rms_K < 0.5 * rows[1].rms_K
    assert 0.0 == rows[1].several < rows["adaptive"].several <= rows[16].several == 1.0
    assert "| adaptive |" in table(list(rows.values())).markdown()
