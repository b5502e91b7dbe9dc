"""The main job on a small scene, through the command line, as a user runs it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import cldit
from cldit.errors import EvaluationError, RunFolderError
from tests.command_line import command
from tests.small_scenes import WHOLE

SMALL: dict[str, Any] = {
    "camera": {
        "pixels": [80, 80],
        **WHOLE,
        "sensor": {"pixels": [64, 48], "bad_pixels": 3},
    },
    "domain": {"leaf_edge_m": 2e-3},
    "plan": {"shots": 3, "references": 2},
    "spray": {"time_s": 0.6e-3},  # while it is injected
}


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`gdi` at low resolution, as a YAML file in a folder whose name has a space."""
    data = cldit.load_scene("gdi-cone").model_dump(mode="json")
    for section, values in SMALL.items():
        data[section].update(values)
    data["camera"]["sensor"] = SMALL["camera"]["sensor"]
    path = tmp_path_factory.mktemp("a folder") / "small.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.fixture(scope="module")
def finished(small_scene: Path) -> Path:
    out = small_scene.parent / "run"
    command("run", small_scene, "--out", out)
    return out


def test_folder_is_complete(finished: Path) -> None:
    for name in (
        "scene.yaml", "rig.yaml", "plan.yaml", "run.json", "report.html",
        "pictures/maps.png", "weights/background.tif", "weights_reference/background.tif",
        "maps/apparent_temperature_K.tif", "acquisition/maps/emissivity.tif",
        "acquisition/journal.jsonl",
    ):  # fmt: skip
        assert (finished / name).stat().st_size > 0, name
    assert len(list((finished / "acquisition/shots").glob("*.tif"))) == 6 * (3 + 2)
    assert not list(finished.rglob("*.part"))


def test_physics_of_the_maps(finished: Path) -> None:
    """Opaque and cold below the injector, warm at the rim of the plumes, transparent outside.

    gdi: fuel 370 K, saturation at 369 K, walls 450 K, gas 570 K: every apparent temperature lies
    between the coldest and the hottest of these, within noise.
    """
    run = cldit.open_run(finished)
    assert run.measured is not None
    temperature = run.maps.apparent_temperature_K
    emissivity = run.maps.emissivity
    below = (slice(16, 18), slice(39, 41))  # 3 to 7 mm below the injector in an 80 x 80 picture
    assert np.all(emissivity[below] > 0.9)
    assert 360 < np.nanmean(temperature[below]) < 450
    known = np.isfinite(temperature) & (emissivity > 0.1)
    assert 360 < temperature[known].min() and temperature[known].max() < 575
    assert np.nanmean(temperature[known]) > np.nanmean(temperature[below]) + 20
    assert np.nanmax(np.abs(emissivity[60:70, 30:50])) < 1e-3
    assert run.measured.emissivity.shape == (48, 64)
    assert run.weights.background.shape == (80, 80)


def test_measured_agrees_with_noise_free(finished: Path) -> None:
    """The rig's maps are those of the trace, within their own errors."""
    run = cldit.open_run(finished)
    assert run.measured is not None
    from cldit.camera.view import SensorView

    ideal = SensorView.from_scene(run.scene).image(run.weights.background)
    seen = run.measured.reason == 0
    miss = (run.measured.emissivity - (1 - ideal))[seen]
    # The disc's rim apart, where a pixel sees part of it.
    z = miss / run.measured.emissivity_standard_error[seen]
    assert abs(np.median(z)) < 1.0
    assert np.median(np.abs(miss)) < 0.02


def test_again_reads_instead_of_tracing_and_shoots_nothing(
    finished: Path, small_scene: Path
) -> None:
    before = (finished / "acquisition/journal.jsonl").read_text()
    said = command("run", small_scene, "--out", finished).output
    assert "read, not traced again" in said
    lines = (finished / "acquisition/journal.jsonl").read_text().removeprefix(before)
    assert '"fired"' not in lines


def test_another_scene_in_the_folder_is_refused(finished: Path) -> None:
    said = command("run", "empty", "--out", finished, status=1).output
    assert "another scene" in said and "--out" in said


def test_a_taken_name_gets_a_new_folder(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """runs/NAME with another scene is left alone; the same scene is found again in runs/NAME-2."""
    monkeypatch.chdir(tmp_path)
    taken = tmp_path / "runs" / "empty"
    taken.mkdir(parents=True)
    (taken / "scene.yaml").write_bytes((finished / "scene.yaml").read_bytes())
    words = ("run", "empty", "--quick", "--trace-only")
    said = command(*words).output
    assert "runs/empty has another scene; this run goes to runs/empty-2" in said
    assert "read, not traced again" in command(*words).output
    assert not (tmp_path / "runs/empty-3").exists()


@pytest.mark.usefixtures("without_pages")
def test_acquire_evaluate_show(finished: Path) -> None:
    out = finished.parent / "again"
    files = (finished / "rig.yaml", finished / "plan.yaml")
    assert "30 of 30 shots" in command("acquire", *files, "--out", out).output
    command("evaluate", out)
    command("show", out)
    assert (out / "maps.png").stat().st_size > 10_000
    command("show", finished)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "gdj"), "did you mean gdi?"),
        (("run", "gdi", "--device", "none such"), "'none such' does not exist"),
        (("run", "gdi", "--cfd", "no/such/case"), "no such file or folder"),
        (("run", "gdi", "--region", "gas"), "spray.region: unknown key"),
        (("run", "gdi", "--accuracy", "-1"), "transport.accuracy_K: -1 is outside"),
        (("evaluate", "no/such/folder"), "no/such/folder"),
        (("show", "no/such/folder"), "no/such/folder"),
        (("acquire", "no.yaml", "no.yaml", "--out", "x"), "no.yaml: cannot be read"),
    ],
)
def test_errors_are_plain_and_say_what_to_do(
    arguments: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = command(*arguments, status=1).output
    assert words in said.replace("\n", " ") and "Traceback" not in said


def test_damaged_run_folders(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="holds no finished run"):
        cldit.open_run(tmp_path)
    (tmp_path / "scene.yaml").write_text((finished / "scene.yaml").read_text())
    with pytest.raises(RunFolderError, match=r"run\.json is missing"):
        cldit.open_run(tmp_path)
    (tmp_path / "run.json").write_text('{"device": 1}')
    with pytest.raises(RunFolderError, match=r"run\.json: is damaged"):
        cldit.open_run(tmp_path)


def test_one_background_can_be_traced_but_not_evaluated(tmp_path: Path) -> None:
    """Weights are there; the maps are empty and say why; the experiment is refused at once."""
    data = cldit.load_scene("droplets-only").model_dump(mode="json")
    data["camera"].update(WHOLE)
    data["camera"]["pixels"] = [20, 20]
    data["domain"]["leaf_edge_m"] = 5e-3
    data["transport"] |= {"audit": False, "order": 0}
    data["background"]["temperatures_K"] = [450.0]
    scene = cldit.Scene.from_dict(data)
    run = cldit.simulate(scene, tmp_path / "traced")
    assert np.nanmin(run.weights.background) < 0.5
    assert np.all(np.isnan(run.maps.emissivity))
    assert np.all(run.maps.reason == 1)
    assert np.all(np.isnan(cldit.open_run(tmp_path / "traced").maps.apparent_temperature_K))
    with pytest.raises(EvaluationError, match=r"background\.temperatures_K: \[450\.0\]"):
        cldit.simulate(scene, tmp_path / "refused", record=True)
    assert not (tmp_path / "refused").exists()
