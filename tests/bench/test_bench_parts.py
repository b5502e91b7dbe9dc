"""Growth, memory and leaving out, measured on a scene so small that only the bookkeeping counts."""

from __future__ import annotations

from pathlib import Path

import pytest

import cldit
from cldit.bench.case import Case, changed
from cldit.bench.growth import Growth, Point, growth
from cldit.bench.leave_out import leave_out
from cldit.bench.memory import memory
from cldit.gpu.device import Device
from cldit.scene import Scene


@pytest.fixture(scope="module")
def tiny() -> Scene:
    scene = cldit.load_scene("droplets-only")
    return changed(
        scene, camera={"pixels": [16, 16]}, domain={"leaf_edge_m": 4e-3}, spray={"time_s": 0.3e-3}
    )


def _quiet(_: str) -> None:
    pass


def test_exponents_are_those_of_power_laws() -> None:
    points = tuple(Point(n, 3.0 * n**1.5) for n in (1.0, 2.0, 8.0))
    one = Growth("pixels", "all", points)
    assert one.exponent == pytest.approx(1.5)
    assert one.last == pytest.approx(1.5)


def test_leaving_out(tiny: Scene, device: Device, tables: Path) -> None:
    """Every part that the scene could do without is there, timed both ways."""
    part = leave_out(Case.of(tiny, device, cache=tables), say=_quiet, directions=1)
    names = {saving["part"] for saving in part.data["savings"]}
    wanted = {"droplets", "vapour", "scattering", "phase function", "background disc"}
    assert names == wanted | {"spectral loop", "empty space cell by cell"}
    for saving in part.data["savings"]:
        assert saving["without_s"] > 0 and saving["with_s"] > 0


@pytest.mark.slow
def test_growth(tiny: Scene, device: Device, tmp_path: Path) -> None:
    case = Case.of(tiny, device, cache=tmp_path)
    part = growth(case, cache=tmp_path, say=_quiet)
    amounts = {one["what"]: [p["amount"] for p in one["points"]] for one in part.data}
    assert set(amounts) == {"pixels", "cells swept", "droplet cells", "orders", "wavelengths"}
    assert amounts["wavelengths"] == [1.0, 3.0, 10.0]
    for values in amounts.values():
        assert values == sorted(values)


@pytest.mark.slow
def test_memory(tiny: Scene, device: Device) -> None:
    """A run holds more than no run, its buffers among it; compiling anew takes longer."""
    part = memory(tiny, device, say=_quiet)
    nothing, *runs = part.data
    assert nothing["fresh"]["buffer_bytes"] == 0
    for run in runs:
        assert run["fresh"]["resident_bytes"] > nothing["fresh"]["resident_bytes"]
        assert 0 < run["fresh"]["buffer_bytes"] < run["fresh"]["resident_bytes"]
        assert run["fresh"]["compile_s"] > run["cached"]["compile_s"]
