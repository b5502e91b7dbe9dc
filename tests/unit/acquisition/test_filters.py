"""Plans of several filters or delays: what they record and what comes out of each."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.acquisition import Plan, acquire, open_acquisition, parse_plan, plan_from_scene
from cldit.acquisition.dry_runs import dry_run
from cldit.acquisition.export import export
from cldit.acquisition.plan import Group
from cldit.api.folder_evaluation import evaluate_folder, evaluate_groups
from cldit.cli import main
from cldit.comparison import compare
from cldit.comparison.shown import open_shown
from cldit.dit.maps import Maps
from cldit.errors import ClditError, EvaluationError, RunFolderError, SceneError
from cldit.io.images import read_image
from cldit.rig.errors import ConfigRejected, DeviceTimeout, NotConnected
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.scene import Scene, dump_scene, parse_scene
from cldit.scene.delays import scene_at
from cldit.show.view.folders import _measured_items
from tests.conftest import tiny_weights
from tests.journals import read_journal
from tests.wrapped import Mission, pulses, refusals

FILTERS = {"fuel": ((3.3, 3.5), 2.0), "droplets": ((3.8, 4.0), 0.7)}  # and optical depth


@pytest.fixture(scope="module")
def behind(tiny_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    """A run behind each filter: the spray at 370 K is thinner where its vapour is transparent."""
    runs = {}
    for name, (edges_um, depth) in FILTERS.items():
        folder = tmp_path_factory.mktemp(name)
        scene = tiny_scene.with_(**{"optics.filter_um": edges_um})
        (folder / "scene.yaml").write_text(dump_scene(scene), encoding="utf-8")
        for part, thick in (("weights", depth), ("weights_reference", 0.0)):
            tiny_weights(scene, depth=thick).save(folder / part, pixel_m=(5e-3, 5e-3))
        runs[name] = [folder]
    return runs


@pytest.fixture
def wheel(
    tiny_scene: Scene, behind: dict[str, list[Path]], tiny_plan: Plan, tmp_path: Path
) -> Mission:
    """The rig with a wheel, and a plan of both filters."""
    data = simulated_rig_data(tiny_scene, behind["fuel"][0], filters=behind)
    data["filter_wheel"]["settings"] = {}
    data["trigger"]["settings"]["pulse_log"] = str(tmp_path / "pulses.jsonl")
    plan = tiny_plan.model_copy(update={"filters": tuple(FILTERS), "shots": 2, "references": 2})
    return Mission(data, plan, tmp_path / "a")


def saved(folder: Path) -> list[dict[str, Any]]:
    return [e for e in read_journal(folder / "journal.jsonl") if e["event"] == "saved"]


def right_light(folder: Path) -> None:
    """Every kept image was taken through the filter that it names, whatever is read from the wheel:
    with one exposure, the black body gives 2.0 (440 K) and 1.8 times (480 K) the counts in 3.8 to
    4.0 um as in 3.3 to 3.5 um, by Planck's law for photons."""
    opened = open_acquisition(folder)
    offset = opened.calibrations[0]["offset_counts"]
    levels: dict[tuple[int, str], list[float]] = {}
    for shot in opened.shots:
        if shot.kind == "reference":
            name = opened.plan.filters[shot.filter]
            level = float(opened.load(shot)[5:7, 7:9].mean()) - offset
            levels.setdefault((shot.background, name), []).append(level)
    for background in (0, 1):
        low, high = (levels[background, name] for name in FILTERS)
        assert max(low) < min(high) / 1.5


def test_ids_and_order() -> None:
    plan = Plan(
        backgrounds_K=(400.0, 440.0),
        filters=("a", "b"),
        delays_s=(1e-3, 2e-3),
        shots=1,
        references=1,
    )
    ids = [shot.id for shot in plan.steps()]
    assert ids[:4] == [
        "b00_f00_d00_ref_00",
        "b00_f00_d00_inj_00",
        "b00_f00_d01_ref_00",
        "b00_f00_d01_inj_00",
    ]
    assert ids[4] == "b00_f01_d00_ref_00" and len(set(ids)) == 16
    assert plan.groups == (Group(0, 0), Group(0, 1), Group(1, 0), Group(1, 1))
    last = plan.steps()[-1]
    assert plan.describe(last) == "440 K, b, 2 ms, injection 1"
    assert [plan.filter_name(shot) for shot in plan.from_filter(plan.steps()[:8], "b")] == [
        *4 * ["b"],
        *4 * ["a"],
    ]


def test_old_plans_keep_their_hash() -> None:
    """The hash of a folder that a version without filters filled."""
    old = parse_plan({"backgrounds_K": [400, 440]})
    assert old.hash() == "aa8f42c36fc5d193d7a89183224685bc79f5b90229aa711978793fa010fe1427"
    assert old.hash() != parse_plan({"backgrounds_K": [400, 440], "filters": ["a"]}).hash()
    assert old.filter_name(old.steps()[0]) is None


def test_each_filter_is_recorded_and_evaluated_apart(wheel: Mission) -> None:
    """The emissivity of each filter is that of its own run, 1 - exp(-depth), where shots scatter by
    5 %, and T_app is 370 K with both; each black body was set once, and the wheel moved thrice."""
    assert wheel.acquire().complete
    entries = read_journal(wheel.folder / "journal.jsonl")
    assert [entry["filter"] for entry in entries if entry["event"] == "filter"] == [
        "fuel", "droplets", "fuel",
    ]  # fmt: skip
    assert [entry["event"] for entry in entries].count("stable") == 2
    for entry in saved(wheel.folder):
        name = tuple(FILTERS)[int(entry["shot"][5:7])]
        assert entry["filter"] == name
        meta = read_image(wheel.folder / "shots" / f"{entry['shot']}.tif")[1]
        assert meta["filter"] == name
    opened = open_acquisition(wheel.folder)
    assert len(opened.shots) == 16 and len(opened.of_group(Group(filter=1)).shots) == 8
    assert opened.of_group(Group(filter=1)).filter_um == (3.8, 4.0)
    with pytest.raises(RunFolderError, match=r"2 filters \(fuel, droplets\)"):
        _ = opened.calibration
    with pytest.raises(RunFolderError, match="filter none; allowed: one of fuel, droplets"):
        open_shown(wheel.folder)
    with pytest.raises(EvaluationError, match=r"group None; allowed: .*: fuel; .*: droplets; "):
        evaluate_folder(wheel.folder)
    assert [group.filter_name for group in evaluate_groups(opened)] == list(FILTERS)
    for name, (_, depth) in FILTERS.items():
        place = wheel.folder / "maps" / name
        maps = Maps.load(place)
        emissivity = float(np.nanmean(maps.emissivity[5:7, 7:9]))
        assert abs(emissivity - (1.0 - np.exp(-depth))) < 0.08
        apparent_K = maps.apparent_temperature_K[5:7, 7:9]
        error_K = maps.apparent_temperature_standard_error_K[5:7, 7:9]
        assert np.all(np.abs(apparent_K - 370.0) < 5.0 * error_K)
    assert {place.name for place in (wheel.folder / "maps").iterdir()} == set(FILTERS)
    (result,) = compare(wheel.folder, wheel.folder, extinction=["droplets"]).results
    assert list(result.by_filter) == list(FILTERS)
    assert result.text.endswith("by 2 filters") and all(p.same for p in result.by_filter.values())
    only = compare({"fuel": wheel.folder}, {"fuel": wheel.folder}).differences
    assert [pair.one for pair in only] == [f"{wheel.folder}, fuel"]


@pytest.mark.slow
def test_commands_and_exports(wheel: Mission) -> None:
    wheel.acquire()
    for command, file in (("evaluate", "report.html"), ("show", "maps.png")):
        result = CliRunner().invoke(main, [command, str(wheel.folder)])
        assert result.exit_code == 0, result.output
        assert all((wheel.folder / "maps" / name / file).is_file() for name in FILTERS)
        if command == "evaluate":
            assert "fuel:" in result.output and "droplets:" in result.output
    h5py = pytest.importorskip("h5py")
    with h5py.File(export(open_acquisition(wheel.folder), "nexus"), "r") as file:
        assert set(file["entry/sequence/filter"].asstr()[:]) == set(FILTERS)
    names = [item.head["name"] for item in _measured_items(wheel.folder)]
    assert names == ["a, fuel", "a, droplets"]


def test_one_filter_is_a_plain_folder(wheel: Mission) -> None:
    """Ids and folders are those without a wheel, the calibration is that of the filter."""
    plan = wheel.plan.model_copy(update={"filters": ("droplets",)})
    assert wheel.acquire(plan=plan).complete
    assert saved(wheel.folder)[0]["shot"] == "b00_ref_00"  # one filter, one delay: plain ids
    (only,) = evaluate_groups(open_acquisition(wheel.folder))
    assert only.filter_name == "droplets" and only.folder == wheel.folder / "maps"
    assert only.evaluation is not None and only.evaluation.calibration.filter_um == (3.8, 4.0)


def test_a_wheel_that_is_turned_between_shots(wheel: Mission) -> None:
    """Somebody turns the wheel after every third reading. Each shot that it spoiled is refused with
    the reason, the wheel is moved back, and all images show the right light."""
    wheel.data["filter_wheel"]["settings"]["turned"] = 0.33
    record = wheel.acquire(plan=wheel.plan.model_copy(update={"retakes": 20}))
    assert record.complete and record.rejected > 2
    reasons = [
        entry["reason"]
        for entry in read_journal(wheel.folder / "journal.jsonl")
        if entry["event"] == "rejected"
    ]
    assert {reason.rpartition(" ")[0] for reason in reasons} <= {
        f"filter: {wrong} in place of {right} {when} the"
        for wrong, right in (("fuel", "droplets"), ("droplets", "fuel"))
        for when in ("before", "after")
    }
    assert any("before" in reason for reason in reasons)
    assert any("after" in reason for reason in reasons)
    right_light(wheel.folder)


def test_a_wheel_that_sticks(wheel: Mission) -> None:
    """The sequence ends with an error, safe, with the images of the first filter; nothing is saved
    under the second one. Once the wheel moves again, the same command completes it."""
    wheel.data["filter_wheel"]["settings"]["sticks_after"] = 0
    rig = wheel.rig()
    with pytest.raises(DeviceTimeout, match=r"at position 1 1 s after 2 \(droplets\)"):
        wheel.acquire(rig)
    assert {entry["filter"] for entry in saved(wheel.folder)} == {"fuel"}
    assert rig.trigger.read_configuration()["inhibited"]
    assert rig.background.read_configuration()["setpoint_K"] == 295.0
    del wheel.data["filter_wheel"]["settings"]["sticks_after"]
    assert wheel.acquire().complete
    right_light(wheel.folder)


@pytest.mark.parametrize(
    ("fault", "value", "error"),
    [("late", 0.1, DeviceTimeout), ("unplug_after", 7, NotConnected)],
)
def test_a_wheel_that_is_lost(
    fault: str, value: float, error: type[Exception], wheel: Mission
) -> None:
    """A reading that does not come ends the sequence; the shot that was fired is lost, not saved,
    and an unreachable wheel is no danger: no false alarm."""
    wheel.data["filter_wheel"]["settings"][fault] = value
    with pytest.raises(error, match="filter_wheel") as caught:
        wheel.acquire()
    assert "not made safe" not in str(caught.value)
    fired = [p for p in pulses(wheel.data) if p["pulses"]]
    events = [entry["event"] for entry in read_journal(wheel.folder / "journal.jsonl")]
    assert events.count("fired") == len(fired) == events.count("saved") + events.count("lost")
    del wheel.data["filter_wheel"]["settings"][fault]
    assert wheel.acquire().complete
    right_light(wheel.folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d, p: p.update(filters=()), "filters: none: the rig has a filter wheel; allowed"),
        (lambda d, p: p.update(filters=("red",)), "filters: red: no such filter; allowed: fuel, d"),
        (lambda d, p: d.pop("filter_wheel"), "filters: fuel, droplets: the rig has no filter whe"),
    ],
)
def test_plans_that_do_not_fit_the_rig(
    change: Callable[[dict[str, Any], dict[str, Any]], Any], message: str, wheel: Mission
) -> None:
    """The dry run and the acquisition refuse in the same words, before anything moves."""
    changed: dict[str, Any] = {}
    change(wheel.data, changed)
    plan = wheel.plan.model_copy(update=changed)
    (problem,) = dry_run(open_rig(wheel.data), plan, wheel.folder).problems
    with pytest.raises(ConfigRejected) as caught:
        acquire(open_rig(wheel.data), plan, wheel.folder)
    assert problem == str(caught.value) and message in problem
    assert not pulses(wheel.data)


def test_a_folder_is_not_continued_with_other_filters(wheel: Mission) -> None:
    wheel.acquire(stop_after=2)
    runs = wheel.data["bench"]["settings"]["filters"]
    runs["fuel"], runs["droplets"] = runs["droplets"], runs["fuel"]
    with pytest.raises(RunFolderError, match="filter fuel: "):
        wheel.acquire()


def test_an_image_of_another_filter_than_planned_is_refused(
    wheel: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal has the filter of every image, and the plan that of every shot."""
    wheel.acquire(stop_after=1)
    monkeypatch.setattr(Plan, "filter_name", lambda self, part: "droplets")
    with pytest.raises(RunFolderError, match="recorded with filter fuel, planned was droplets"):
        open_acquisition(wheel.folder)


def test_the_dry_run_counts_the_moves(wheel: Mission) -> None:
    """Three moves of 1 s: both filters, then the second is there at the second background."""
    plain = wheel.plan
    wheel.data["filter_wheel"]["settings"]["moving_s"] = 0.0
    still_s = dry_run(open_rig(wheel.data), plain, wheel.folder).time_s
    wheel.data["filter_wheel"]["settings"]["moving_s"] = 10.0
    assert dry_run(open_rig(wheel.data), plain, wheel.folder).time_s - still_s == 30.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["bench"]["settings"].pop("filters"), "filters: is missing; a simulated wheel"),
        (lambda d: d["bench"]["settings"]["filters"].update(red=[]), "filters.red"),
        (lambda d: d["filter_wheel"]["settings"].update(stuck=1), "settings.stuck: unknown key"),
        (lambda d: d["filter_wheel"].update(driver="fw103"), "did you mean fw102c?"),
    ],
)
def test_rig_files(change: Callable[[dict[str, Any]], Any], message: str, wheel: Mission) -> None:
    change(wheel.data)
    with pytest.raises(SceneError) as caught:
        open_rig(wheel.data)
    assert message in str(caught.value)


def test_runs_of_another_scene_behind_a_filter(
    wheel: Mission, tiny_scene: Scene, tmp_path: Path
) -> None:
    scene = tiny_scene.with_(**{"walls.temperature_K": 430.0})
    (tmp_path / "scene.yaml").write_text(dump_scene(scene), encoding="utf-8")
    for part in ("weights", "weights_reference"):
        tiny_weights(scene, depth=1.0).save(tmp_path / part, pixel_m=(5e-3, 5e-3))
    wheel.data["bench"]["settings"]["filters"]["fuel"] = [str(tmp_path)]
    with pytest.raises(NotConnected, match="filters: fuel: its runs differ from `run`"):
        wheel.acquire()


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
