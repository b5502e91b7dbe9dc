"""What keeps a plan from running, or ends it: limits, disks, power, devices that lie."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from cldit.acquisition import Progress, iterate, open_acquisition
from cldit.acquisition.journal import Journal
from cldit.acquisition.storage import save_shot
from cldit.errors import DiskFull
from cldit.rig.errors import (
    DeviceTimeout,
    NotConnected,
    RigError,
)
from tests.wrapped import Mission, assert_safe, pulses


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
