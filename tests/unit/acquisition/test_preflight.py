"""Reasons to refuse or end a plan; a dry run refuses it in the same words."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cldit.acquisition import Progress, acquire, dry_run, iterate, open_acquisition
from cldit.acquisition.journal import Journal
from cldit.acquisition.plan import TriggerSection
from cldit.acquisition.storage import save_shot
from cldit.errors import DiskFull
from cldit.io.exclusive import exclusive
from cldit.rig.errors import (
    DeviceTimeout,
    NotConnected,
    OutOfLimits,
    RigError,
)
from tests.wrapped import Mission, assert_safe, pulses, refusals

Wrap = dict[str, Callable[[Any], dict[str, Any]]]


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ({"backgrounds_K": (440.0, 2000.0)}, "backgrounds_K: 2000 is outside 253..873"),
        (
            {"backgrounds_K": (180.0, 440.0)},
            "backgrounds_K: 180 is outside 253..873 K; 180 °C are 453.15 K",
        ),
        ({"integration_time_s": 5.0}, "integration_time_s: 5 is outside"),
        ({"integration_time_s": 1e-9}, "integration_time_s: 1e-09 is outside"),
        ({"frame_timeout_s": 1e-3}, "frame_timeout_s: 0.001 is shorter than a shot, 0.0015"),
        (
            {"trigger": TriggerSection(camera_delay_s=0.9), "frame_timeout_s": 0.5},
            "frame_timeout_s: 0.5 is shorter than a shot, 0.9001",
        ),
    ],
)
def test_plans(plan: dict[str, Any], message: str, mission: Mission) -> None:
    bad = mission.plan.model_copy(update=plan)
    moved: list[float] = []
    rig = mission.rig(background=lambda _: {"set_setpoint": moved.append})
    dry, wet = refusals(rig, bad, mission.folder)
    assert dry == wet and any(message in line for line in dry), dry
    assert not moved and not pulses(mission.data)
    assert not (mission.folder / "plan.yaml").exists()  # the corrected plan may go here


def test_all_that_is_impossible_is_told_together(mission: Mission) -> None:
    bad = mission.plan.model_copy(
        update={"backgrounds_K": (100.0, 2000.0), "integration_time_s": 5.0}
    )
    dry, wet = refusals(mission.rig(), bad, mission.folder)
    assert dry == wet and len(dry) >= 4
    assert dry_run(mission.rig(), bad, mission.folder).disk_bytes > 10 * 2 * 16 * 12
    with pytest.raises(OutOfLimits, match=r"(?s)2000 is outside.*integration_time_s: 5"):
        acquire(mission.rig(), bad, mission.folder)


@pytest.mark.parametrize(
    ("devices", "message"),
    [
        (
            {"camera": lambda c: {"identify": lambda: replace(c.identify(), simulated=False)}},
            "clock.model: simulated, but camera is real",
        ),
        ({"camera": lambda c: {"read_configuration": dict}}, "has no 'calibration'"),
        (
            {"camera": lambda c: {"read_configuration": lambda: {"x": float("nan")}}},
            "cannot be stored",
        ),
        ({"trigger": lambda t: {"configure": lambda b: replace(b, n=2)}}, "trigger: reads back"),
        (
            {"trigger": lambda t: {"configure": lambda b: replace(b, camera_delay_s=1.0)}},
            "camera_delay_s: reads back 1",
        ),
        ({"camera": lambda c: {"read_frames": lambda n, timeout_s: iter(())}}, "0 of 1 frames"),
    ],
)
def test_instruments(devices: Wrap, message: str, mission: Mission) -> None:
    dry, wet = refusals(mission.rig(**devices), mission.plan, mission.folder)
    # The acquisition's burst injects and the dry run's does not; all else is the same.
    assert [line.replace("inject=True", "inject=False") for line in wet] == dry
    assert any(message in line for line in dry), dry
    assert not pulses(mission.data) or "frames" in message


def _file(folder: Path) -> None:
    folder.write_text("")


def _plan_is_a_folder(folder: Path) -> None:
    (folder / "plan.yaml").mkdir(parents=True)


def _journal_is_torn(folder: Path) -> None:
    folder.mkdir()
    (folder / "journal.jsonl").write_text("{\n")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_file, "cannot be written"),
        (_plan_is_a_folder, "plan.yaml: cannot"),
        (_journal_is_torn, "line 1"),
    ],
)
def test_folders(
    spoil: Callable[[Path], Any],
    message: str,
    mission: Mission,
) -> None:
    spoil(mission.folder)
    dry, wet = refusals(mission.rig(), mission.plan, mission.folder)
    assert dry == wet and message in "\n".join(dry), dry


def test_a_folder_in_use(mission: Mission) -> None:
    with exclusive(mission.folder, "acquisition"):
        dry, wet = refusals(mission.rig(), mission.plan, mission.folder)
    assert dry == wet and "another acquisition is running here" in dry[0]


def test_a_disk_that_is_too_small(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    free = type("usage", (), {"free": 100_000})
    monkeypatch.setattr("cldit.acquisition.disk.shutil.disk_usage", lambda path: free)
    dry, wet = refusals(mission.rig(), mission.plan, mission.folder)
    assert dry == wet and "make room, or choose another folder" in dry[0]
    with pytest.raises(DiskFull):
        mission.acquire(mission.rig())


def test_another_plan_or_rig_than_before(mission: Mission) -> None:
    mission.acquire(mission.rig(), should_stop=lambda: True)
    other = mission.plan.model_copy(update={"shots": 4})
    dry, wet = refusals(mission.rig(), other, mission.folder)
    assert dry == wet and any("holds another plan" in line for line in dry)
    mission.data["setup"]["wall_temperature_K"] = 300.0
    dry, wet = refusals(mission.rig(), mission.plan, mission.folder)
    assert dry == wet and any("wall_temperature_K: 420.0 before" in line for line in dry)


def test_a_lost_configuration_is_not_replaced(mission: Mission) -> None:
    """The images before would be evaluated with the calibration of the rig of today."""
    mission.acquire(stop_after=2)
    (mission.folder / "configuration.json").unlink()
    mission.data["setup"]["wall_temperature_K"] = 300.0
    dry, wet = refusals(mission.rig(), mission.plan, mission.folder)
    assert dry == wet and "configuration.json: is missing beside images; restore it" in dry[0]


def test_a_dry_run_never_lets_a_trigger_inject(mission: Mission) -> None:
    """It is not made safe afterwards, so it must not bring the rig into a state that needs it."""
    seen: list[bool] = []

    def noted(trigger: Any) -> dict[str, Any]:
        def configure(burst: Any) -> Any:
            seen.append(burst.inject)
            return trigger.configure(burst)

        return {"configure": configure}

    rig = mission.rig(trigger=noted)
    found = dry_run(rig, mission.plan, mission.folder)
    assert found.problems == () and seen == [False]
    assert rig.trigger.read_configuration()["inhibited"]
    assert rig.background.read_configuration()["setpoint_K"] == 295.0
    assert not mission.folder.exists() and not pulses(mission.data)


def test_background_that_never_settles(mission: Mission) -> None:
    mission.data["background"]["settings"]["noise_K"] = 3.0
    rig = mission.rig()
    with pytest.raises(DeviceTimeout, match=r"not stable at 440 K.*stability\.timeout_s"):
        mission.acquire(rig)
    assert_safe(rig)
    assert not pulses(mission.data)


def test_the_set_point_is_read_back(mission: Mission) -> None:
    rig = mission.rig(background=lambda _: {"set_setpoint": lambda kelvin: kelvin + 10.0})
    with pytest.raises(RigError, match="reads back 450 K"):
        mission.acquire(rig)
    assert not pulses(mission.data)


def test_all_missing_devices_are_named(mission: Mission, tmp_path: Path) -> None:
    mission.data["bench"]["settings"]["run"] = str(tmp_path / "nowhere")
    mission.data["trigger"]["settings"]["pulse_log"] = str(tmp_path / "no" / "pulses.jsonl")
    with pytest.raises(NotConnected, match=r"(?s)camera: .*scene\.yaml.*trigger: .*no such folder"):
        mission.acquire()


def test_disk_full_while_writing(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fifth image finds no room: the rig is safe, four are kept, the same call resumes."""
    count = 0

    def full(*args: Any, **kwargs: Any) -> str:
        nonlocal count
        count += 1
        if count == 5:
            raise OSError(28, "No space left on device")
        return save_shot(*args, **kwargs)

    monkeypatch.setattr("cldit.acquisition.sequence.save_shot", full)
    rig = mission.rig()
    with pytest.raises(DiskFull, match=r"b00_inj_02\.tif: the disk is full.*free 1 MB.*resumes"):
        mission.acquire(rig)
    assert_safe(rig)
    assert len(open_acquisition(mission.folder).shots) == 4
    record = mission.acquire()
    assert record.complete and record.lost_injections == 1


@pytest.mark.parametrize("error", [ZeroDivisionError, SystemExit, KeyboardInterrupt])
def test_an_error_elsewhere_leaves_the_rig_safe_and_is_not_hidden(
    error: type[BaseException], mission: Mission
) -> None:
    def broken(progress: Progress) -> None:
        if progress.done == 3:
            raise error("in the caller's progress bar")

    rig = mission.rig()
    with pytest.raises(error):
        mission.acquire(rig, progress=broken)
    assert_safe(rig)


def test_power_cut_ordering(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    """Order of writes: the `fired` line before its trigger; the image, and its name in
    the folder, before the `saved` line and before anybody is told."""
    if not Path("/proc/self/fd").is_dir():
        pytest.skip("needs /proc to tell which file is synced")
    happened: list[tuple[str, str]] = []
    sync, append = os.fsync, Journal.append

    def fsync(handle: int) -> None:
        sync(handle)
        happened.append(("synced", os.path.basename(os.readlink(f"/proc/self/fd/{handle}"))))

    def line(self: Journal, event: str, **values: Any) -> Any:
        happened.append(("line", f"{event} {values.get('shot', '')}"))
        return append(self, event, **values)

    def firing(trigger: Any) -> dict[str, Any]:
        def fire() -> None:
            happened.append(("fire", ""))
            trigger.fire()

        return {"fire": fire}

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Journal, "append", line)
    for saved in iterate(mission.rig(trigger=firing), mission.plan, mission.folder):
        shot = saved.shot.id
        begin = happened.index(("line", f"fired {shot}"))
        fired = happened.index(("fire", ""), begin)
        assert ("synced", "journal.jsonl") in happened[begin:fired]
        noted = happened.index(("line", f"saved {shot}"), fired)
        for name in (f"{shot}.tif", "shots"):
            assert ("synced", name) in happened[fired:noted], name


@pytest.mark.parametrize("damage", ["half", "zeros", "empty"])
def test_power_cut_tears_a_picture(damage: str, mission: Mission) -> None:
    """A power cut after the trigger and before the sync: the name is there, the data are not, and
    the journal ends with `fired`. It is put aside, written off, and taken again."""
    mission.acquire(stop_after=4)
    lines = (mission.folder / "journal.jsonl").read_bytes().splitlines(keepends=True)
    kept = max(n for n, text in enumerate(lines) if b'"fired"' in text)
    (mission.folder / "journal.jsonl").write_bytes(b"".join(lines[: kept + 1]))
    path = mission.folder / "shots" / "b00_inj_01.tif"
    data = path.read_bytes()
    torn = {
        "half": data[: len(data) // 2],
        "zeros": data[:300] + bytes(len(data) - 300),
        "empty": b"",
    }
    path.write_bytes(torn[damage])
    record = mission.acquire()
    assert record.complete and record.lost_injections == 1
    assert path.with_name(path.name + ".torn").read_bytes() == torn[damage]
    acquisition = open_acquisition(mission.folder)
    assert len({acquisition.load(shot).tobytes() for shot in acquisition.shots}) == 10
