"""A run ends with its result; a field keeps the nozzle in sight, and what it cuts is said."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import cldit
from cldit.cli import main
from cldit.cli.console import ProgressBar
from cldit.prepare.stages import StageLine, Stages

_COARSE = ("--trace-only", "--pixels", "32", "--accuracy", "20", "--set", "domain.leaf_edge_m=6e-3")


def _run(folder: Path, *words: str) -> str:
    done = CliRunner().invoke(main, ["run", "gdi-cone", *_COARSE, "--out", str(folder), *words])
    assert done.exit_code == 0, done.output
    return done.output.replace(str(folder), "RUN")


def test_a_run_ends_with_its_result(tmp_path: Path) -> None:
    lines = _run(tmp_path / "run", "--field", "60").splitlines()
    found = dict(line.split(" ", 1) for line in lines if " " in line)
    run = cldit.open_run(tmp_path / "run")
    seen = run.maps.apparent_temperature_K[run.maps.has_temperature]
    low, high, median = map(float, re.findall(r"[\d.]+", found["T_app"]))
    assert (low, high) == pytest.approx(tuple(np.percentile(seen, (1, 99))), abs=0.06)
    assert median == pytest.approx(float(np.median(seen)), abs=0.06)
    count = f"{int(run.maps.has_temperature.sum())} of 32 x 32 traced pixels"
    assert f"  in {count} with an emissivity above 0.05" in lines
    assert run.errors is not None
    stated = [line for line in lines if line.startswith("error of ")]
    largest, most = run.errors.largest(), run.errors.largest(of_emissivity=True)
    assert largest is not None and most is not None and len(stated) == 2
    for line, text, cause in zip(
        stated,
        (f"T_app {run.errors.text}", f"emissivity {run.errors.emissivity_text}"),
        (largest, most),
        strict=True,
    ):
        assert f"error of {text} RMS; largest source: {cause.name}, " in line
    assert (
        f"liquid {1e3 * run.info.spray['liquid_penetration_95_m']:.1f} mm" in found["penetration:"]
    )
    assert lines[-2:] == ["RUN/maps", "next: cldit view RUN"]
    assert "octree" not in "".join(lines) and "OpenCL" not in "".join(lines)
    # 60 mm: 5 mm are above the nozzle
    assert run.scene.target_m == pytest.approx((0.0, 0.0, -0.025))


def test_what_the_field_cuts_is_said_and_stages_are_behind_v(tmp_path: Path) -> None:
    kept = "camera.target_m=[0.0, 0.0, -0.01]"
    text = _run(tmp_path / "run", "--field", "60x12", "-v", "--set", kept)
    assert re.search(r"cuts the visible spray at its edges: .*bottom \(\d+ pixels\)", text)
    assert "  octree\n" in text and "OpenCL device" in text and "error by" in text
    assert cldit.open_run(tmp_path / "run").scene.target_m == (0.0, 0.0, -0.01)


def test_only_stages_are_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    said: list[Any] = []
    stages = Stages(said.append)
    with stages.stage("spray"):
        stages.remark(["a remark"])
    assert [isinstance(line, StageLine) for line in said] == [True, False]
    for line in said:
        ProgressBar().say(line)
    assert capsys.readouterr().out == "  a remark\n"
    ProgressBar(stages=True).say(said[0])
    assert capsys.readouterr().out == "  spray\n"
