"""Plans of several delays: what they record, how long it takes, what is refused, what comes out."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.acquisition import Plan, acquire, open_acquisition, parse_plan, plan_from_scene
from cldit.acquisition.export import export
from cldit.acquisition.plan import Group
from cldit.api.folder_evaluation import evaluate_folder, evaluate_groups
from cldit.cli import main
from cldit.dit.maps import Maps
from cldit.errors import ClditError, EvaluationError, SceneError
from cldit.io.images import read_image
from cldit.rig.load import open_rig
from cldit.scene import Scene, parse_scene
from cldit.scene.delays import scene_at
from tests.wrapped import refusals

DELAYS_s = (0.5e-3, 0.95e-3, 1.5e-3)
FOLDERS = ("delay_0.5ms", "delay_0.95ms", "delay_1.5ms")


def test_each_delay_alternates_within_each_background() -> None:
    plan = Plan(backgrounds_K=(400.0, 440.0), delays_s=(1e-3, 2e-3), shots=2, references=2)
    one = ["ref_00", "inj_00", "inj_01", "ref_01"]
    ids = [f"b0{b}_d0{d}_{shot}" for b in (0, 1) for d in (0, 1) for shot in one]
    assert [shot.id for shot in plan.steps()] == ids
    bursts = [plan.burst(shot).camera_delay_s for shot in plan.steps()]
    assert bursts == 2 * (4 * [1e-3] + 4 * [2e-3])


def test_one_delay_is_the_same_plan_wherever_it_stands() -> None:
    """Ids and hash are those of folders that older versions filled."""
    old = parse_plan({"backgrounds_K": [400], "trigger": {"camera_delay_s": 2e-3}})
    new = parse_plan({"backgrounds_K": [400], "delays_s": [2e-3]})
    assert old.hash() == new.hash() and old.steps() == new.steps()
    assert old.hash() != parse_plan({"backgrounds_K": [400], "delays_s": [2e-3, 3e-3]}).hash()
    assert Plan(backgrounds_K=(400.0,), shots=1).steps()[0].id == "b00_ref_00"


def test_a_spray_without_a_time_is_refused() -> None:
    scene = parse_scene(
        {"name": "a", "spray": {"model": "none"}, "plan": {"delays_s": [1e-3, 2e-3]}}
    )
    with pytest.raises(SceneError, match=r"spray\.model none has no time"):
        scene_at(scene, 1e-3)
    later = scene_at(parse_scene({"name": "a", "spray": {"model": "cone"}}), 2e-3).spray
    assert getattr(later, "time_s", None) == 2e-3


def _took_s(rig: dict[str, Any], plan: Plan, folder: Path) -> float:
    opened = open_rig(rig)
    start_s = opened.clock.now_s()
    assert acquire(opened, plan, folder).complete
    return opened.clock.now_s() - start_s


def test_three_delays_take_hardly_longer_than_one(
    tiny_scene: Scene, rig_of_three: dict[str, Any], plan_of_three: Plan, tmp_path: Path
) -> None:
    """The rig's own time, waits for the black body included, with a scene's usual shots."""
    plan = plan_of_three.model_copy(update={"shots": 5, "references": 5})
    plan = plan.model_copy(update={"backgrounds_K": plan.backgrounds_K[:2]})
    one = _took_s(rig_of_three, plan.model_copy(update={"delays_s": DELAYS_s[:1]}), tmp_path / "1")
    three = _took_s(rig_of_three, plan, tmp_path / "3")
    assert plan_from_scene(tiny_scene).pause_s == 1.0
    assert one < three <= 1.15 * one


@pytest.mark.usefixtures("without_pages")
def test_maps_table_and_exports_by_delay(
    rig_of_three: dict[str, Any], plan_of_three: Plan, tmp_path: Path
) -> None:
    """The spray of each delay is another: its emissivity in the middle is 1 - exp(-depth), where
    shots scatter by 5 %; and each background was set once."""
    folder = tmp_path / "a"
    acquire(open_rig(rig_of_three), plan_of_three, folder)
    opened = open_acquisition(folder)
    assert len(opened.shots) == 45 and len(opened.of_group(Group(delay=1)).shots) == 15
    assert (folder / "journal.jsonl").read_text().count('"event": "stable"') == 3
    result = CliRunner().invoke(main, ["evaluate", str(folder)])
    assert result.exit_code == 0, result.output
    for name, depth in zip(FOLDERS, (0.5, 1.0, 2.0), strict=True):
        emissivity = Maps.load(folder / "maps" / name).emissivity
        assert abs(float(np.nanmean(emissivity[5:7, 7:9])) - (1.0 - np.exp(-depth))) < 0.08
        assert (folder / "maps" / name / "evaluation.json").is_file()
    table = (folder / "maps" / "delays.csv").read_text()
    rows = list(csv.DictReader(table.splitlines()))
    assert [float(row["delay_s"]) for row in rows] == list(DELAYS_s)
    medians = [float(row["emissivity"]) for row in rows]
    assert medians == sorted(medians) and "0.95 ms: " in result.output
    shown = CliRunner().invoke(main, ["show", str(folder)])
    assert shown.exit_code == 0, shown.output
    assert all((folder / "maps" / name / "maps.png").is_file() for name in FOLDERS)
    h5py = pytest.importorskip("h5py")
    with h5py.File(export(opened, "nexus"), "r") as file:
        assert set(file["entry/sequence/camera_delay"][:]) == set(DELAYS_s)
    allowed = r"allowed: one of Group\(filter=0, delay=0\): 0.5 ms; "
    with pytest.raises(EvaluationError, match=f"group None; {allowed}"):
        evaluate_folder(folder)
    with pytest.raises(EvaluationError, match=rf"group Group\(filter=0, delay=3\); {allowed}"):
        evaluate_folder(folder, group=Group(delay=3))


@pytest.mark.slow
def test_one_bad_delay_keeps_none_of_the_others(
    rig_of_three: dict[str, Any], plan_of_three: Plan, tmp_path: Path
) -> None:
    """Every injection of one delay is lost: the others have maps, and the command says which."""
    folder = tmp_path / "a"
    acquire(open_rig(rig_of_three), plan_of_three, folder)
    for path in (folder / "shots").glob("b*_d01_inj_*.tif"):
        path.unlink()
    groups = evaluate_groups(open_acquisition(folder))
    assert [group.evaluation is not None for group in groups] == [True, False, True]
    assert groups[1].problem
    result = CliRunner().invoke(main, ["evaluate", str(folder)])
    assert result.exit_code == 1 and "at 0.95 ms:" in result.output
    assert len((folder / "maps" / "delays.csv").read_text().splitlines()) == 3
    assert read_image(folder / "maps" / FOLDERS[2] / "emissivity.tif")[0].shape == (12, 16)


def test_a_scene_of_one_time_says_so(
    rig_of_three: dict[str, Any],
    tiny_rig: dict[str, Any],
    plan_of_three: Plan,
    tmp_path: Path,
) -> None:
    del rig_of_three["bench"]["settings"]["runs"]
    for data, message in (
        (rig_of_three, "its spray at 0.5 ms only, not at 0.95 ms, 1.5 ms"),
        (tiny_rig, "its spray at one time only"),
    ):
        dry, wet = refusals(open_rig(data), plan_of_three, tmp_path / "a")
        assert dry == wet and message in "\n".join(dry)


def test_every_delay_is_checked(
    rig_of_three: dict[str, Any], plan_of_three: Plan, tmp_path: Path
) -> None:
    """A shot at the middle delay alone would count as missing."""
    plan = plan_of_three.model_copy(update={"delays_s": (0.5e-3, 0.9, 1.5e-3), "shots": 0})
    plan = plan.model_copy(update={"frame_timeout_s": 0.5})
    dry, wet = refusals(open_rig(rig_of_three), plan, tmp_path / "a")
    assert dry == wet and "frame_timeout_s: 0.5 is shorter than a shot, 0.9001" in dry[0]


def test_runs_of_another_scene_are_refused(
    rig_of_three: dict[str, Any], tiny_run: Path, plan_of_three: Plan, tmp_path: Path
) -> None:
    rig_of_three["bench"]["settings"]["runs"] = [str(tiny_run)]
    with pytest.raises(ClditError, match="its spray has no time_s"):
        acquire(open_rig(rig_of_three), plan_of_three, tmp_path / "a")
