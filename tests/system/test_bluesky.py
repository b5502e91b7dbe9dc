"""A bluesky RunEngine steps through an acquisition; what it does to it, cldit's runner survives."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cldit.acquisition import Plan, open_acquisition
from tests.journals import read_journal
from tests.wrapped import pulses

if TYPE_CHECKING:
    from bluesky import RunEngine
else:
    RunEngine = pytest.importorskip("bluesky", reason="install cldit[bluesky]").RunEngine

from bluesky.protocols import Readable, Stageable, Triggerable
from bluesky.utils import FailedStatus, RunEngineInterrupted

from cldit.api.bluesky import Shots, all_shots

Documents = list[tuple[str, dict[str, Any]]]


@pytest.fixture
def engine() -> Iterator[RunEngine]:
    made = RunEngine(context_managers=[])  # no signals: tests press no keys
    yield made
    made._loop.call_soon_threadsafe(made._loop.stop)
    made._th.join(10.0)
    made._loop.close()


@pytest.fixture
def documents(engine: RunEngine) -> Documents:
    found: Documents = []
    engine.subscribe(lambda name, document: found.append((name, document)))
    return found


def events(documents: Documents) -> list[dict[str, Any]]:
    return [document["data"] for name, document in documents if name == "event"]


def fired(folder: Path) -> list[bool]:
    journal = read_journal(folder / "journal.jsonl")
    return [entry["inject"] for entry in journal if entry["event"] == "fired"]


def test_a_whole_plan(
    engine: RunEngine,
    documents: Documents,
    tiny_rig: dict[str, Any],
    tiny_plan: Plan,
    tmp_path: Path,
) -> None:
    """An event for each shot, in the plan's order, with the file that holds it; safe at the end,
    and a second run finds nothing left to do."""
    shots = Shots(tiny_rig, tiny_plan, tmp_path / "a")
    for protocol in (Readable, Stageable, Triggerable):
        assert isinstance(shots, protocol)
    engine(all_shots(shots, {"operator": "test"}))
    found = events(documents)
    assert [event["dit_shot"] for event in found] == [shot.id for shot in tiny_plan.steps()]
    assert {event["dit_kind"] for event in found} == {"reference", "injection"}
    assert all(Path(event["dit_file"]).is_file() for event in found)
    for event, shot in zip(found, tiny_plan.steps(), strict=True):
        assert event["dit_background_before_K"] == pytest.approx(shot.background_K, abs=1.0)
    start, stop = documents[0][1], documents[-1][1]
    assert start["operator"] == "test" and stop["exit_status"] == "success"
    assert open_acquisition(tmp_path / "a").complete
    assert read_journal(tmp_path / "a" / "journal.jsonl")[-2]["event"] == "finished"
    documents.clear()
    engine(all_shots(Shots(tiny_rig, tiny_plan, tmp_path / "a")))
    assert not events(documents)
    assert [pulse["inject"] for pulse in pulses(tiny_rig)] == fired(tmp_path / "a")


def interrupted(engine: RunEngine, shots: Shots, action: Callable[[], Any], after: int) -> None:
    """Asks the engine for something from another thread, in the middle of shot `after`."""
    trigger, count = shots.trigger, 0

    def counted() -> Any:
        nonlocal count
        count += 1
        status = trigger()
        if count == after:
            threading.Thread(target=action, daemon=True).start()
            time.sleep(0.05)
        return status

    shots.trigger = counted  # type: ignore[method-assign]
    with pytest.raises(RunEngineInterrupted):
        engine(all_shots(shots))


@pytest.mark.parametrize("defer", [True, False])
def test_pause_and_resume(
    defer: bool,
    engine: RunEngine,
    documents: Documents,
    tiny_rig: dict[str, Any],
    tiny_plan: Plan,
    tmp_path: Path,
) -> None:
    """Nothing is fired again, and no event is lost or doubled, wherever the pause falls."""
    shots = Shots(tiny_rig, tiny_plan, tmp_path / "a")
    interrupted(engine, shots, lambda: engine.request_pause(defer), after=4)
    assert engine.state == "paused"
    engine.resume()
    assert [event["dit_shot"] for event in events(documents)] == [
        shot.id for shot in tiny_plan.steps()
    ]
    assert [pulse["inject"] for pulse in pulses(tiny_rig)] == fired(tmp_path / "a")


def test_abort_leaves_the_rig_safe_and_resumes(
    engine: RunEngine,
    documents: Documents,
    tiny_rig: dict[str, Any],
    tiny_plan: Plan,
    tmp_path: Path,
) -> None:
    shots = Shots(tiny_rig, tiny_plan, tmp_path / "a")
    interrupted(engine, shots, engine.request_pause, after=3)
    engine.abort()
    assert documents[-1][1]["exit_status"] == "abort"
    events_of = [entry["event"] for entry in read_journal(tmp_path / "a" / "journal.jsonl")]
    assert events_of[-2:] == ["stopped", "made safe"] and 3 <= events_of.count("saved") < 10
    engine(all_shots(Shots(tiny_rig, tiny_plan, tmp_path / "a")))
    assert open_acquisition(tmp_path / "a").complete
    assert [pulse["inject"] for pulse in pulses(tiny_rig)] == fired(tmp_path / "a")


def test_an_error_of_the_rig_ends_the_run(
    engine: RunEngine,
    documents: Documents,
    tiny_rig: dict[str, Any],
    tiny_plan: Plan,
    tmp_path: Path,
) -> None:
    tiny_rig["camera"]["settings"]["unplug_after"] = 4
    with pytest.raises(FailedStatus) as caught:
        engine(all_shots(Shots(tiny_rig, tiny_plan, tmp_path / "a")))
    assert "unplug" in str(caught.value.__cause__)
    assert documents[-1][1]["exit_status"] == "fail"
