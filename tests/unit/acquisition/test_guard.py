"""The guard where the rig cannot be made safe: it must not be quiet, and must name what is on."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from cldit.acquisition import Progress, iterate
from cldit.acquisition import guard as guard_module
from cldit.acquisition.guard import Guard, watch
from cldit.acquisition.journal import Journal
from cldit.rig.errors import NotConnected, RigError
from cldit.rig.load import Rig, open_rig
from tests.journals import read_journal
from tests.wrapped import Mission, wrapped


def dead() -> None:
    raise NotConnected("the line is dead")


def stuck(data: dict[str, Any]) -> Rig:
    """A rig whose black body is not reached when it is to be made safe."""
    return wrapped(data, background=lambda _: {"make_safe": dead})


def told(data: dict[str, Any], end: bytes) -> io.BytesIO:
    """What comes through the pipe."""
    rig_file = yaml.safe_dump(data)
    return io.BytesIO(f"{len(rig_file.encode())}\n{rig_file}".encode() + end)


@pytest.fixture
def begun(tmp_path: Path) -> Path:
    with Journal(tmp_path / "journal.jsonl") as journal:
        journal.append("start", time="2026-01-01T00:00:00+00:00")
    return tmp_path


def last(folder: Path) -> dict[str, Any]:
    return read_journal(folder / "journal.jsonl")[-1]


def test_a_regular_end_needs_no_guard(tiny_rig: dict[str, Any], begun: Path) -> None:
    assert watch(told(tiny_rig, b"safe\n"), begun) == 0
    assert not (begun / "guard.log").exists() and last(begun)["event"] == "start"


def test_a_death_is_made_safe_and_noted(tiny_rig: dict[str, Any], begun: Path) -> None:
    assert watch(told(tiny_rig, b""), begun) == 0
    assert "every device is safe" in (begun / "guard.log").read_text()
    assert last(begun)["event"] == "made safe" and last(begun)["problems"] == []


def test_what_does_not_cool_is_loud_and_not_tried_again(
    tiny_rig: dict[str, Any], begun: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller in manual output confirms its set point: another attempt would not help."""

    def manual(data: dict[str, Any]) -> Rig:
        rig = open_rig(data)
        monkeypatch.setattr(rig.background, "read_temperature", lambda: 460.0)
        return rig

    monkeypatch.setattr(guard_module, "open_rig", manual)
    assert watch(told(tiny_rig, b""), begun) == 1
    log = (begun / "guard.log").read_text()
    assert "NOT SAFE" in log and "does not cool: 460.0 K" in log and "attempt" not in log
    assert last(begun)["event"] == "unsafe" and "does not cool" in last(begun)["problems"][0]


def test_what_cannot_be_made_safe_is_loud(
    tiny_rig: dict[str, Any],
    begun: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit status, log, journal and terminal name the device, after three attempts; the trigger
    and the camera are made safe all the same."""
    monkeypatch.setattr(guard_module, "open_rig", stuck)
    monkeypatch.setattr(guard_module, "_PAUSES_s", (0.0, 0.0, 0.0))
    assert watch(told(tiny_rig, b""), begun) == 1
    said = "background: the line is dead; the black body may still be hot: switch it off by hand"
    log = (begun / "guard.log").read_text()
    assert log.count("failed") == 3 and "NOT SAFE" in log and said in log
    assert last(begun)["event"] == "unsafe" and last(begun)["problems"] == [said]
    printed = capsys.readouterr().err
    assert "THE RIG IS NOT SAFE" in printed and said in printed and "trigger" not in printed


def test_a_rig_file_that_is_gone_is_loud(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(guard_module, "_PAUSES_s", (0.0,))
    assert watch(told({"camera": {"driver": "no such"}}, b""), tmp_path) == 1
    assert "NOT SAFE" in (tmp_path / "guard.log").read_text()
    assert "NOT SAFE" in capsys.readouterr().err


def test_the_acquisition_says_it_too(mission: Mission) -> None:
    with pytest.raises(RigError, match="the black body may still be hot"):
        mission.acquire(stuck(mission.data))
    entry = last(mission.folder)
    assert entry["event"] == "unsafe" and "may still be hot" in entry["problems"][0]
    record = mission.acquire()  # such a journal can be read
    assert record.complete


def test_a_loop_that_is_left_says_it_too(mission: Mission) -> None:
    shots = iterate(stuck(mission.data), mission.plan, mission.folder)
    next(shots)
    with pytest.raises(RigError, match="the black body may still be hot"):
        shots.close()


@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt])
def test_a_process_that_is_ended_says_it_too(
    error: type[BaseException],
    mission: Mission,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def ending(progress: Progress) -> None:
        if progress.done == 2:
            raise error

    with pytest.raises(error) as caught:
        mission.acquire(stuck(mission.data), progress=ending)
    assert "may still be hot" in caught.value.__notes__[0]
    assert "THE RIG IS NOT SAFE" in capsys.readouterr().err


def test_the_guards_process_takes_over(tiny_rig: dict[str, Any], begun: Path) -> None:
    """The rig's own attempt fails, that of the other process does not; both are said."""
    rig = wrapped(
        tiny_rig,
        background=lambda _: {"make_safe": dead},
        camera=lambda camera: {"identify": lambda: replace(camera.identify(), simulated=False)},
    )
    with Guard(rig, begun) as guard:
        problems = guard.make_safe()
    assert "the black body may still be hot" in problems[0]
    assert problems[1] == "the guard then made every device safe, in a process of its own"
    assert "every device is safe" in (begun / "guard.log").read_text()
    assert last(begun)["event"] == "made safe"
