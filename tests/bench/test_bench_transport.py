"""`cldit bench transport` on a small scene: what it measures is sane; how fast is not asserted."""

from __future__ import annotations

import json
from pathlib import Path

import cldit
from cldit.bench import bench_transport, write_bench
from cldit.gpu.device import Device


def test_errors_fall_with_directions_and_orders(device: Device, tmp_path: Path) -> None:
    """Droplets alone at low resolution: order 0 is far off, order 3 and 64 directions are near."""
    data = cldit.load_scene("droplets-only").model_dump(mode="json")
    data["camera"]["pixels"] = [50, 50]
    data["domain"]["leaf_edge_m"] = 3e-3
    scene = cldit.parse_scene(data)
    ways = (
        ("source, 8 directions", {"directions": 8}),
        ("source, 64 directions", {"directions": 64}),
        ("source, order 0", {"order": 0}),
        ("source, order 3", {"order": 3}),
    )
    few, many, none, three = bench_transport(scene, device, ways)
    assert many.rms_K < few.rms_K
    assert three.rms_K < none.rms_K
    assert none.rms_K > 1.0 > many.rms_K
    assert none.stated_K is None and many.stated_K is not None
    picture = write_bench([few, many, none, three], tmp_path / "out", title="small")
    assert picture.stat().st_size > 5000
    assert len(json.loads((tmp_path / "out/bench.json").read_text())) == 4
