"""A run computed anew: the same, or what differs; inputs that are not what it read are named."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.api.repeat import inputs_that_changed, repeat
from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.io.images import read_image, write_image
from cldit.io.origin import FileRead, Origin
from cldit.run import Run, open_run, simulate
from cldit.scene import Scene
from tests.command_line import command
from tests.digests import without_digests


@pytest.fixture(scope="module")
def run(
    tiny_scene: Scene, device: Device, tables: Path, tmp_path_factory: pytest.TempPathFactory
) -> Run:
    folder = tmp_path_factory.mktemp("repeated") / "run"
    return simulate(tiny_scene, folder, device=device, cache=tables)


def test_the_record_says_how(run: Run) -> None:
    assert run.folder is not None
    data = json.loads((run.folder / "run.json").read_text())
    origin = data["origin"]
    assert origin["seeds"] == {"transport.seed": 1, "rig.seed": 1, "spray.scatter.seed": 1}
    assert origin["date"].endswith("+00:00") and origin["command"] and origin["processor"]
    assert {"cldit", "numpy", "pyopencl", "python", "opencl"} <= set(data["versions"])
    assert open_run(run.folder).info == run.info


def test_it_is_the_same_and_its_folder_stays_empty(run: Run, tmp_path: Path) -> None:
    assert run.folder is not None
    done = command("compare", run.folder, "--repeat", "--json", "--out", tmp_path / "again")
    found = json.loads(done.stdout)
    assert found["within"] and found["trace"]["same"]
    assert found["recorded"] is None and found["inputs"] == []
    with pytest.raises(RunFolderError, match="is not empty"):
        repeat(run.folder, out=tmp_path / "again")


def test_what_differs_is_told(run: Run, tmp_path: Path) -> None:
    """A stored map that says otherwise than its weights is found by computing it anew."""
    assert run.folder is not None
    copy = without_digests(run.save(tmp_path / "copy"))
    path = copy / "maps" / "emissivity.tif"
    image = read_image(path)[0]
    write_image(path, (image + np.float32(0.1)).astype(np.float32), name="emissivity", unit="1")
    done = command("compare", copy, "--repeat", status=3)
    assert "no pixel has a T_app in both" in done.output


def test_a_scene_of_another_version_has_not_changed(run: Run, tmp_path: Path) -> None:
    """Its text has other keys; what counts is the file that the run wrote."""
    without_digests(run.save(tmp_path / "old"))
    file = tmp_path / "old" / "scene.yaml"
    file.write_text(file.read_text(encoding="utf-8") + "# of an older version\n", encoding="utf-8")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    stored = open_run(tmp_path / "old")
    origin = replace(Origin.now(inputs=[]), scene_sha256=digest)
    assert inputs_that_changed(replace(stored, info=replace(stored.info, origin=origin))) == ()
    file.write_text(file.read_text(encoding="utf-8") + "#\n", encoding="utf-8")
    assert inputs_that_changed(replace(stored, info=replace(stored.info, origin=origin)))


def test_inputs_are_named(run: Run, tmp_path: Path) -> None:
    kept, lost = tmp_path / "kept.csv", tmp_path / "lost.csv"
    for path in (kept, lost):
        path.write_text("1")
    origin = replace(
        Origin.now(inputs=[FileRead.of(kept), FileRead.of(lost)]), scene_sha256="0" * 64
    )
    kept.write_text("2")
    lost.unlink()
    stale = replace(run, info=replace(run.info, origin=origin), folder=None)
    scene, first, second = inputs_that_changed(stale)
    assert scene.endswith("scene.yaml: has changed since the run")
    assert first.startswith(f"{kept}: has changed (1 bytes of")
    assert second == f"{lost}: cannot be read (No such file or directory)"
    stale.save(tmp_path / "stale")
    done = command("compare", tmp_path / "stale", "--repeat", status=1)
    assert str(lost) in done.stderr and "--changed-inputs" in done.stderr
    command("repeat", tmp_path / "stale", "--changed-inputs")  # its old name
