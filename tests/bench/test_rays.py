"""`cldit bench --only rays` on a small scene: more rays, less error, more pixels refined."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cldit.bench.case import Case
from cldit.bench.rays import ADAPTIVE_K, EVEN, at_edges, bench_rays
from cldit.gpu.device import Device
from cldit.scene import parse_scene


def test_more_rays_come_nearer(device: Device, tmp_path: Path, tables: Path) -> None:
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
    case = Case.of(scene, device, cache=tables)
    found, edges = bench_rays(case, say=lambda _: None)
    rows = {row.rays: row for row in found}
    even = [rows[str(number)] for number in EVEN]
    adaptive = [rows[f"adaptive, {kelvin:g} K"] for kelvin in ADAPTIVE_K]
    assert len(rows) == len(even) + len(adaptive)
    assert edges > 50
    for key in ("rms_K", "edge_K"):
        one, four, sixteen, most = (getattr(row, key) for row in even)
        assert most < sixteen < four < one
        # Those that are refined get 16; what is not is as with one.
        assert all(0.99 * sixteen <= getattr(row, key) < one for row in adaptive)
        assert getattr(adaptive[-1], key) < 0.5 * one
    several = [row.several for row in (even[0], *adaptive, even[2])]
    assert several == sorted(several)
    assert (several[0], several[-1]) == (0.0, 1.0)


def test_edges_are_both_sides_of_a_step() -> None:
    background = np.ones((4, 5))
    background[:, 3:] = 0.5
    expected = np.zeros((4, 5), bool)
    expected[:, 2:4] = True
    np.testing.assert_array_equal(at_edges(background), expected)
