"""An image that takes long, or much memory, is announced with the source that needs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy import remarks
from cldit.accuracy.allocation import Allocation
from cldit.accuracy.remarks import expected
from cldit.medium.frame import Cube
from cldit.medium.octree import PointSource, Sources
from cldit.scene import Scene, load_scene
from cldit.transport.trace import TraceSettings, settings_for
from cldit.transport.trace_cost import TraceCost
from tests.small_scenes import WHOLE_KEYS

GB = 1e9


def box() -> Sources:
    """Droplets in two corners of a cube of 0.1 m."""
    one = np.ones(2)
    place = np.array([[-0.0499] * 3, [0.0499] * 3])
    return PointSource(place, one, one, one, None, (one,)), []


def remark(
    *,
    depth: int = 6,
    coarse: TraceCost | None,
    ordinates: int = 24,
    keys: Mapping[str, Any] | None = None,
) -> tuple[str, ...]:
    camera = {"camera.pixels": [100, 100], **WHOLE_KEYS}
    gdi: Scene = load_scene("gdi-cone").with_(**{**camera, **(keys or {})})
    settings: TraceSettings = replace(settings_for(gdi), final_directions=ordinates)
    frame = Cube((-0.05, -0.05, -0.05), edge_m=0.1, depth=depth)
    device: Any = SimpleNamespace(info=SimpleNamespace(memory_bytes=int(1e15)))
    allocation = Allocation.of(gdi, 1.0)
    prepared: Any = SimpleNamespace(scene=gdi, device=device, sources=box())
    costs = [] if coarse is None else [coarse]
    return expected(prepared, frame, [settings], coarse=costs, allocation=allocation)


COARSE = TraceCost(cells=32**3, ordinates=24, pixels=10_000, sweeps_s=1.0, rays_s=1.0)


def test_an_image_of_a_minute_is_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remarks, "memory_bytes", lambda _: 64 * GB)
    assert remark(coarse=COARSE) == remark(depth=7, coarse=None) == ()  # 8 + 2 core-s; unknown
    (text,) = remark(depth=7, coarse=COARSE)  # 64 + 4
    assert text.startswith("expected for the image: 68 core-s and 0.017 GB")
    assert "2.1e+06 cells of 0.78 mm, 24 ordinates, 1 wavelength; most of it by cells" in text
    assert text.endswith(f"for {Allocation.of(load_scene('gdi-cone'), 1.0)['cells']:.2g} K")
    (text,) = remark(coarse=COARSE, ordinates=24 * 20, keys={"transport.directions": 160})
    assert text.endswith("most of it by trace, set by transport.directions")
    (text,) = remark(depth=7, coarse=COARSE, keys={"domain.leaf_edge_m": 1e-3})
    assert text.endswith("most of it by cells, set by domain.leaf_edge_m")


def test_half_of_the_memory_is_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where nothing was traced before, and no time is known."""
    monkeypatch.setattr(remarks, "memory_bytes", lambda _: 0.03 * GB)
    assert remark(coarse=None) == ()
    (text,) = remark(depth=7, coarse=None)
    assert text.startswith("expected for the image: 0.017 GB, by ")
