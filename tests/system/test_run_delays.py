"""A scene of several delays through the command line: traced, recorded, evaluated, reported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import cldit
from cldit.dit.maps import Maps
from tests.command_line import command
from tests.small_scenes import WHOLE

SMALL: dict[str, Any] = {
    "camera": {"pixels": [32, 32], **WHOLE},
    "spray": {"spacing_m": 2e-3},
    "background": {"temperatures_K": [440.0, 480.0]},
    "domain": {"leaf_edge_m": 4e-3},
    "transport": {"audit": False},
    "plan": {"shots": 2, "references": 2, "delays_s": [0.6e-3, 0.95e-3]},
}


@pytest.mark.slow
def test_a_run_of_two_delays(tmp_path: Path) -> None:
    """The later spray covers more of the picture; the run itself shows the scene's own time."""
    data = cldit.load_scene("gdi-cone").model_dump(mode="json")
    for section, values in SMALL.items():
        data[section].update(values)
    data["camera"]["sensor"] = {"pixels": [24, 18]}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(data))
    out = tmp_path / "run"
    command("run", tmp_path / "scene.yaml", "--out", out)
    places = [out / "acquisition" / "maps" / f"delay_{name}" for name in ("0.6ms", "0.95ms")]
    early, late = (Maps.load(place) for place in places)
    thick = [int(np.sum(maps.emissivity > 0.5)) for maps in (early, late)]
    assert 0 < thick[0] < thick[1]
    run = cldit.open_run(out)
    assert run.measured is not None
    np.testing.assert_array_equal(run.measured.emissivity, late.emissivity)
    assert cldit.open_run(out / "delay_0.6ms").scene.plan.delays_s == ()
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "0.6 ms: " in report and "0.95 ms: " in report
    shots = len(list((out / "acquisition" / "shots").iterdir()))
    command("run", tmp_path / "scene.yaml", "--out", out)  # nothing is left to do
    assert len(list((out / "acquisition" / "shots").iterdir())) == shots == 2 * 2 * 4
    assert "temperature of the medium" in command("evaluate", out, "--model", out).output
