"""One of the paper's studies from end to end, small; the same again costs nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.cli import main
from cldit.dit.separation import NEEDED
from cldit.errors import EvaluationError
from cldit.run import RunCache, reevaluated
from cldit.study.lab import Lab
from cldit.study.page import write_page
from cldit.study.paper import STUDIES, run_study
from cldit.study.paper.maps import all_round
from cldit.study.paper.rivals import models

# An analytic spray of few cells.
_TINY = {
    "spray": {"model": "cone", "spacing_m": 0.003, "size_classes": 1},
    "camera.pixels": [50, 50],
    "domain.leaf_edge_m": 0.003,
    "transport.directions": 8,
}
_FEW = {**_TINY, "camera.pixels": [16, 16]}  # where only what is traced counts


@pytest.mark.slow
def test_walls(tmp_path: Path) -> None:
    """Six walls from one trace; then all of it from the cache."""
    lab = Lab(RunCache(tmp_path / "cache"), quick=True, always=_TINY)
    page = run_study("walls", lab)
    assert lab.runs.computed == ["gdi", "gdi"]  # the second on cells of twice the edge
    assert len(page.table) == 6 and set(page.scenes) == {"gdi"} and page.quick
    assert write_page(page, tmp_path / "out").is_file()

    again = Lab(RunCache(tmp_path / "cache"), quick=True, always=_TINY)
    repeated = run_study("walls", again)
    assert again.runs.computed == []
    assert [v.value for v in repeated.verdicts] == pytest.approx(
        [v.value for v in page.verdicts], nan_ok=True
    )

    run = lab.run(page.scenes["gdi"])
    joined = all_round(run)
    # All that is not emitted comes from the background: 1 - emissivity is both weights' share.
    np.testing.assert_allclose(
        1.0 - joined.maps.emissivity[20:30, 20:30],
        (run.weights.background + run.weights.wall)[20:30, 20:30]
        / (run.reference.background + run.reference.wall)[20:30, 20:30],
        atol=1e-5,  # float32 weights
    )
    with pytest.raises(EvaluationError, match="is not served by the trace"):
        reevaluated(run, run.scene.with_(**{"optics.k": 0.1}))


def test_damaged_run_is_made_anew(tmp_path: Path) -> None:
    kept = RunCache(tmp_path)
    scene = Lab(kept).gdi("none").with_(**{"spray": {"model": "none"}, "camera.pixels": [8, 8]})
    kept.run(scene)
    (folder,) = (each for each in (tmp_path / "runs").iterdir() if each.is_dir())
    (folder / "run.json").write_text("{")
    kept.run(scene)
    assert kept.computed == ["none", "none"]


_KILLED = """
import os, signal, sys
from pathlib import Path
from cldit.run import RunCache
from cldit.study.lab import Lab

def say(text):
    if len(lab.runs.computed) == 1 and text.strip() == "octree":
        os.kill(os.getpid(), signal.SIGKILL)

lab = Lab(RunCache(Path(sys.argv[1])), quick=True, always=eval(sys.argv[2]), say=say)
for order in range(3):
    lab.run(lab.gdi(f"order-{order}", {"transport.order": order}))
"""


@pytest.mark.slow
def test_what_a_killed_study_had_traced_is_not_traced_again(tmp_path: Path) -> None:
    """Killed in the second trace of three: two more, and nothing the time after."""
    program = [sys.executable, "-c", _KILLED, str(tmp_path), repr(_FEW)]
    died = subprocess.run(program, capture_output=True, text=True)
    assert died.returncode == -signal.SIGKILL, died.stderr
    for computed in (2, 0):
        lab = Lab(RunCache(tmp_path), quick=True, always=_FEW)
        for order in range(3):
            lab.run(lab.gdi(f"order-{order}", {"transport.order": order}))
        assert len(lab.runs.computed) == computed
        assert not list((tmp_path / "runs").glob("*.part"))


def test_names() -> None:
    shown = CliRunner().invoke(main, ["study", "wals"])
    assert shown.exit_code == 1
    refused = CliRunner().invoke(main, ["study", "walls", "--scheduler", "tcp://here:1"])
    assert refused.exit_code == 1
    assert next(iter(STUDIES)) == "methane"


@pytest.mark.long
def test_all_quick(tmp_path: Path) -> None:
    """Every study runs, and each of its pictures is small enough for a page."""
    result = CliRunner().invoke(main, ["study", "all", "--quick", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    for name in STUDIES:
        assert (tmp_path / f"{name}.html").is_file()
    assert all(path.stat().st_size < 600_000 for path in tmp_path.glob("*.png"))


@pytest.mark.slow
def test_extinction_separates_what_t_app_does_not(tmp_path: Path) -> None:
    """Coarse sprays: Dukowicz' liquid is a third less, and the extinction shows it."""
    coarse = {
        "camera.pixels": [24, 24],
        "camera.sensor.pixels": [24, 24],
        "domain.leaf_edge_m": 3e-3,
        "spray.box.spacing_m": 2.5e-3,
        "spray.droplets_per_parcel": 2e4,
        "transport.directions": 8,
    }
    lab = Lab(RunCache(tmp_path), quick=True, always=coarse)
    found = models(lab, campaigns=0)
    # four models with twelve draws each, six unknowns, wider cells; in two bands
    assert len(lab.runs.computed) == 2 * (4 + 4 * 12 + 6 + 1) and len(found.table) == 6
    assert float(found.values["t_app"]) < NEEDED < float(found.values["extinction"])
    row = next(one for one in found.table if one["models"] == "abramzon-sirignano / dukowicz")
    assert row["separated by"] != "none" and float(found.values["liquid"]) > 0.2
    near = next(one for one in found.table if one["models"] == "spalding / frolov-type")
    assert near["separated by"] == "none"
