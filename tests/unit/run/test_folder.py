"""A run folder: what is damaged is named, and inputs are recorded with their checksums."""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.accuracy.errors import Cause, Errors
from cldit.acquisition import open_acquisition
from cldit.api.folder_evaluation import evaluate_folder
from cldit.errors import RunFolderError
from cldit.io.digests import UNVERIFIED
from cldit.io.exclusive import exclusive
from cldit.io.images import write_image
from cldit.io.origin import FileRead, files_read
from cldit.run.folder import open_run, stored_run
from cldit.run.record import origin_of
from cldit.run.result import RunInfo
from cldit.scene import Scene, dump_scene, parse_scene
from tests.bit_flips import flipped_bits

WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(WRITTEN, tmp_path / "r"))


def info(folder: Path, **changed: Any) -> None:
    path = folder / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changed}))


def small(path: Path) -> None:
    write_image(path, np.zeros((3, 4), np.float32), name="x", unit="1")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda r: (r / "scene.yaml").write_text("hello: [1,2\n"), r"scene\.yaml: is damaged \(is"),
        (lambda r: (r / "scene.yaml").write_bytes(b"\xff\xfe"), r"scene\.yaml: is damaged.*UTF-8"),
        (
            lambda r: (r / "scene.yaml").write_text("- 1\n"),
            r"scene\.yaml: is damaged \(contains list",
        ),
        (lambda r: (r / "run.json").write_text('{"a"'), r"run\.json: is damaged \(Expecting"),
        (lambda r: (r / "run.json").write_text("{}"), r"run\.json: is damaged \('stages'\)"),
        (lambda r: info(r, spray=[]), r"run\.json: is damaged \(spray: .*object"),
        (lambda r: info(r, accuracy_K="2"), r"run\.json: is damaged \(accuracy_K"),
        (lambda r: info(r, unknown=1), r"run\.json: is damaged \(.*unknown"),
        (lambda r: (r / "weights" / "wall.tif").unlink(), r"wall\.tif: cannot be read"),
        (
            lambda r: (r / "weights" / "wall.tif").write_bytes(b"II*\0"),
            r"wall\.tif: cannot be read",
        ),
        (lambda r: small(r / "weights" / "wall.tif"), r"wall\.tif: is damaged \(shape \(3, 4\)"),
        (lambda r: small(r / "maps" / "emissivity.tif"), r"emissivity\.tif: is damaged \(shape"),
    ],
)
def test_damage_is_named(folder: Path, damage: Callable[[Path], Any], message: str) -> None:
    open_run(folder)
    damage(folder)
    with pytest.raises(RunFolderError, match=message):
        open_run(folder)


def test_whoever_goes_on_names_it_too(folder: Path) -> None:
    scene = open_run(folder).scene
    (folder / "scene.yaml").write_text("hello: [1,2\n")
    with pytest.raises(RunFolderError, match=r"scene\.yaml: is damaged"):
        stored_run(folder, scene)


def test_a_run_of_another_scene_is_not_taken(folder: Path) -> None:
    other = open_run(folder).scene.with_(**{"walls.temperature_K": 401.0})
    with pytest.raises(RunFolderError, match="holds a run of another scene"):
        stored_run(folder, other)


def test_maps_that_a_full_disk_cut_short_are_made_anew(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The trace is whole: the same command goes on from there. Who only looks is told."""
    run = open_run(folder)
    monkeypatch.setattr("cldit.run.folder.version", lambda name: run.info.versions[name])
    place = folder / "acquisition" / "maps"
    shutil.copytree(folder / "maps", place, dirs_exist_ok=True)
    assert (again := stored_run(folder, run.scene)) is not None and again.measured is not None
    (place / "reason.tif").unlink()
    assert (again := stored_run(folder, run.scene)) is not None and again.measured is None
    with pytest.raises(RunFolderError, match=r"reason\.tif: cannot be read"):
        open_run(folder)


def test_two_runs_into_one_folder(tmp_path: Path) -> None:
    """While one writes, the second is refused before it traces anything."""
    out = tmp_path / "run"
    held, end = threading.Event(), threading.Event()

    def first() -> None:
        with exclusive(out, "run"):
            held.set()
            end.wait(60.0)

    thread = threading.Thread(target=first)
    thread.start()
    try:
        assert held.wait(60.0)
        for record in (False, True):
            with pytest.raises(RunFolderError, match="another run is running here"):
                cldit.simulate("gdi", out, record=record)
    finally:
        end.set()
        thread.join()


def test_errors_are_read_with_their_sum(folder: Path) -> None:
    errors = Errors.of([Cause("cells", 0.5, "coarser")], [Cause("optical data", None, "another k")])
    info(folder, errors=errors.to_dict())
    assert open_run(folder).errors == errors


def test_a_folder_of_0_1_0_is_not_verified(folder: Path) -> None:
    """It is read, with a line; written again it has digests."""
    assert open_run(folder).info.remarks[-1] == UNVERIFIED
    assert any(UNVERIFIED in line for line in open_acquisition(folder / "acquisition").damage)


def _written(folder: Path, target: Path) -> Path:
    """The run with digests; what it is made of is that of the stored one."""
    run = open_run(folder)
    run.save(target)
    data = json.loads((target / "run.json").read_text())
    assert {"scene.yaml", "maps/emissivity.tif", "weights/wall.tif", ""} <= set(data["sha256"])
    return target


def _differs(one: cldit.Run, other: cldit.Run) -> bool:
    """True if anything that was read is another, but the line on digests."""
    images = [{**vars(run.maps), **run.weights.images, **run.error_maps} for run in (one, other)]
    texts = [(run.scene, replace(run.info, remarks=())) for run in (one, other)]
    return texts[0] != texts[1] or any(
        name not in images[1]
        or not np.array_equal(image, images[1][name], equal_nan=image.dtype.kind == "f")
        for name, image in images[0].items()
    )


@pytest.mark.parametrize("mutations", [150, pytest.param(2000, marks=pytest.mark.long)])
def test_no_mutation_of_several_bits_is_silent(
    folder: Path, tmp_path: Path, mutations: int
) -> None:
    """Up to five bits of up to two files: an error, or the run as it was."""
    target = _written(folder, tmp_path / "new")
    before = open_run(target)
    files = sorted(file for file in target.rglob("*") if file.is_file()
                   and "acquisition" not in file.parts)  # fmt: skip
    rng = np.random.default_rng(7)
    silent = []
    for number in range(mutations):
        with flipped_bits(files, rng) as chosen, suppress(RunFolderError):
            if _differs(before, open_run(target)):
                silent.append((number, [str(file) for file in chosen]))
    assert silent == [] and not _differs(before, open_run(target))


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


def test_a_run_keeps_them(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes(b"abc")
    old = RunInfo.from_dict(json.loads((WRITTEN / "run.json").read_text()))
    assert old.files == ()
    info = replace(old, files=files_read([file]))
    assert RunInfo.from_dict(json.loads(info.to_json())) == info
