"""Inputs that a result's record names, with their checksums."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np

from cldit.api.folder_evaluation import evaluate_folder
from cldit.io.origin import FileRead
from cldit.run.record import origin_of
from cldit.run.result import RunInfo
from cldit.scene import Scene, dump_scene, parse_scene

WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"


def scene(**spray: object) -> Scene:
    return parse_scene({"name": "a", "spray": spray})


def test_own_grids_and_tables_are_inputs(tmp_path: Path) -> None:
    grid = tmp_path / "grid.npz"
    np.savez(grid, a=np.ones(3))
    asked = scene(model="grid", file=str(grid))
    origin = origin_of(asked, ())
    (one,) = origin.inputs
    assert one.path == str(grid.resolve())
    assert one.sha256 == hashlib.sha256(grid.read_bytes()).hexdigest()
    assert origin.scene_sha256 == hashlib.sha256(dump_scene(asked).encode()).hexdigest()


def test_files_of_a_case_are_inputs_but_not_those_of_an_import(tmp_path: Path) -> None:
    """cldit's own file stands for the case that it was imported from, which may be elsewhere."""
    case, mesh, kept = tmp_path / "case.foam", tmp_path / "mesh", tmp_path / "kept.npz"
    for path in (case, mesh, kept):
        path.write_bytes(path.name.encode())
    files = (FileRead.of(mesh),)
    found = origin_of(scene(model="cfd", file=str(case)), files).inputs
    assert [Path(one.path).name for one in found] == ["mesh", "case.foam"]
    found = origin_of(scene(model="cfd", file=str(kept)), files).inputs
    assert [Path(one.path).name for one in found] == ["kept.npz"]


def test_evaluations_say_what_they_were_made_from(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(WRITTEN / "acquisition", tmp_path / "shots"))
    found = evaluate_folder(folder)
    stored = json.loads((folder / "maps" / "evaluation.json").read_text())
    assert found.origin is not None and stored["origin"] == json.loads(
        json.dumps(found.origin.to_dict())
    )
    names = [Path(one["path"]).name for one in stored["origin"]["inputs"]]
    assert names == ["plan.yaml", "configuration.json", "journal.jsonl"]
    assert "numpy" in stored["versions"]


def test_times_of_old_runs_are_not_negative() -> None:
    data = json.loads((WRITTEN / "run.json").read_text())
    assert min(stage["seconds"] for stage in data["stages"]) < 0.0
    info = RunInfo.from_dict(data)
    assert min(stage.seconds for stage in info.stages) == 0.0 and info.origin is None
