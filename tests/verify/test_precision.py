"""Problems beyond single precision continue in double precision, or end with an error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import cldit
from cldit.bench.case import changed
from cldit.errors import NotConvergedError
from cldit.gpu.device import Device
from cldit.transport.trace import trace
from tests.bench.case import Case
from tests.small_scenes import WHOLE


@pytest.mark.slow
def test_a_tolerance_below_rounding_is_reached_in_double(device: Device, tables: Path) -> None:
    """GMRES stalls, and reports it or continues in double precision."""
    if not device.info.float64:
        pytest.skip("the device has no double precision")
    scene = changed(
        cldit.load_scene("droplets-only"),
        camera={"pixels": [20, 20], **WHOLE},
        domain={"leaf_edge_m": 4e-3},
        transport={"phase": "isotropic"},
    )
    case = Case.of(scene, device, cache=tables)
    settings = replace(case.settings(audit=False), tolerance=1e-9, directions=8, final_directions=8)
    lines: list[str] = []
    run = trace(case.tree, case.scene, device, settings, report=lines.append)
    assert run.precision == "float64"
    assert any("repeating in double precision" in line for line in lines)
    assert run.iterations is not None and run.source_error <= 1e-9
    with pytest.raises(NotConvergedError, match=r"increase transport\.accuracy_K"):
        trace(case.tree, case.scene, device, replace(settings, precision="float32"))
