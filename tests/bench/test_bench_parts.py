"""Memory and roofline, measured on scenes so small that only the bookkeeping counts."""

from __future__ import annotations

from pathlib import Path

import pytest

import cldit
from cldit.bench.case import changed
from cldit.gpu.device import Device
from cldit.scene import Scene
from tests.bench.case import Case
from tests.bench.memory import memory
from tests.bench.roofline import roofline


@pytest.fixture(scope="module")
def tiny() -> Scene:
    scene = cldit.load_scene("droplets-only")
    return changed(
        scene, camera={"pixels": [16, 16]}, domain={"leaf_edge_m": 4e-3}, spray={"time_s": 0.3e-3}
    )


@pytest.fixture(scope="module")
def case(device: Device, tables: Path) -> Case:
    """Droplets alone at low resolution."""
    scene = cldit.load_scene("droplets-only")
    camera = {"pixels": [50, 40], "field_m": [0.1, 0.08]}
    scene = changed(scene, camera=camera, domain={"leaf_edge_m": 3e-3})
    return Case.of(scene, device, cache=tables)


def _quiet(_: str) -> None:
    pass


@pytest.mark.slow
def test_floor_is_below_what_kernels_take(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy within the cache is quicker than memory: the floor lies lower still."""
    monkeypatch.setattr("tests.bench.roofline._COPY_BYTES", 8 * 2**20)
    monkeypatch.setattr("tests.bench.roofline._ROUNDS", 64)  # a hundredth of a second is enough
    part = roofline(case, directions=2)
    for line in part.data["lines"]:
        assert 0 < line["roofline_s"] < line["core_s"]


@pytest.mark.long
def test_memory(tiny: Scene, device: Device) -> None:
    """A run holds more than no run, its buffers among it; compiling anew takes longer."""
    part = memory(tiny, device, say=_quiet)
    nothing, *runs = part.data
    assert nothing["fresh"]["buffer_bytes"] == 0
    for run in runs:
        assert run["fresh"]["resident_bytes"] > nothing["fresh"]["resident_bytes"]
        assert 0 < run["fresh"]["buffer_bytes"] < run["fresh"]["resident_bytes"]
        assert run["fresh"]["compile_s"] > run["cached"]["compile_s"]
