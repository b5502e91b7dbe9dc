"""A plan run on the simulated rig: whole, stopped, resumed, and with instruments that fail."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.acquisition import Progress, acquire, open_acquisition
from cldit.acquisition.plan import plan_from_scene
from cldit.rig.errors import (
    Aborted,
    FireUncertain,
    NotConnected,
    RetakesExhausted,
)
from cldit.rig.load import open_rig
from cldit.rig.protocols import Frame
from cldit.scene import Scene
from tests.journals import read_journal
from tests.wrapped import Mission, assert_safe, events, pulses


def test_references_and_injections_alternate(
    tiny_rig: dict[str, Any], tiny_scene: Scene, tmp_path: Path
) -> None:
    """The plan as a scene gives it: shots in turns, stopped within a background, and resumed."""
    plan = plan_from_scene(tiny_scene)
    folder = tmp_path / "a"
    done = 0

    def count(progress: Progress) -> None:
        nonlocal done
        done = progress.done

    acquire(open_rig(tiny_rig), plan, folder, progress=count, should_stop=lambda: done >= 3)
    record = acquire(open_rig(tiny_rig), plan, folder)
    assert record.complete and record.lost_injections == 0
    fired = [e["shot"] for e in read_journal(folder / "journal.jsonl") if e["event"] == "fired"]
    # On resuming the black body is at the first background, and goes on there.
    assert fired == [shot.id for shot in plan.steps()]
    assert "".join(name[4] for name in fired[:5]) not in ("rriii", "iiirr")
    assert [shot.id for shot in open_acquisition(folder).shots] == fired


def test_long_waits_keep_the_sessions_alive(
    mission: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the black body settles, camera and generator are asked at least once a minute."""
    rig = open_rig(mission.data)
    asked: dict[str, list[float]] = {"camera": [], "trigger": []}
    for name, times_s in asked.items():
        plain = rig.devices[name].read_configuration

        def noted(plain: Any = plain, times_s: list[float] = times_s) -> dict[str, Any]:
            times_s.append(rig.clock.now_s())
            return dict(plain())

        monkeypatch.setattr(rig.devices[name], "read_configuration", noted)
    stability = mission.plan.stability.model_copy(update={"settle_s": 300.0})
    slow = mission.plan.model_copy(update={"stability": stability})
    assert mission.acquire(rig, slow).complete
    for times_s in asked.values():
        assert len(times_s) > 600.0 / 60.0
        assert max(np.diff(times_s)) < 60.0


def test_whole_plan(mission: Mission) -> None:
    """Every shot once, fired before it is saved, evaluated folder complete, spray only where
    fuel was injected."""
    seen: list[Progress] = []
    rig = mission.rig()
    record = mission.acquire(rig, progress=seen.append)
    assert (record.complete, record.saved, record.lost_injections) == (True, 10, 0)
    assert_safe(rig)
    entries = read_journal(mission.folder / "journal.jsonl")
    for shot in mission.plan.steps():
        mine = [entry["event"] for entry in entries if entry.get("shot") == shot.id]
        assert mine == ["fired", "saved"]
    assert [pulse["inject"] for pulse in pulses(mission.data)] == 2 * [
        False,
        False,
        True,
        True,
        True,
    ]

    acquisition = open_acquisition(mission.folder)
    assert acquisition.complete and acquisition.simulated and acquisition.pixel_m == (0.01, 0.01)
    assert acquisition.filter_um == (3.3, 3.5) and acquisition.wall_temperature_K == 420.0
    middle: dict[tuple[int, str], list[float]] = {}
    for shot_ in acquisition.shots:
        # The black body stays within the plan's tolerance; readings scatter by 0.02 K.
        assert abs(shot_.background_K - shot_.background_setpoint_K) < 0.3
        counts = acquisition.load(shot_)[5:7, 7:9].mean()
        middle.setdefault((shot_.background, shot_.kind), []).append(float(counts))
    for background in (0, 1):
        reference, injection = middle[background, "reference"], middle[background, "injection"]
        assert max(injection) < 0.7 * min(reference)  # optical depth 2
        assert len(set(injection)) == 3  # shots differ

    assert seen[0].phase == "preflight" and seen[-1].done == seen[-1].total == 10
    assert [p.done for p in seen] == sorted(p.done for p in seen)
    etas = [p.eta_s for p in seen if p.eta_s is not None]
    assert etas[0] > 300.0 and etas[-1] == 0.0


def test_stop_finishes_the_shot_and_resume_completes(mission: Mission) -> None:
    rig = mission.rig()
    record = mission.acquire(rig, stop_after=4)
    assert (record.complete, record.saved) == (False, 4)
    assert_safe(rig)
    assert open_acquisition(mission.folder).missing[0] == "b00_inj_02"
    early = {path: path.stat().st_mtime_ns for path in (mission.folder / "shots").iterdir()}

    record = mission.acquire()
    assert record.complete and record.lost_injections == 0
    assert all(path.stat().st_mtime_ns == time for path, time in early.items())
    assert len(pulses(mission.data)) == 10
    acquisition = open_acquisition(mission.folder)
    pictures = {acquisition.load(shot).tobytes() for shot in acquisition.shots}
    assert len(pictures) == 10  # a resumed rig does not repeat its noise
    times = [entry["time"] for entry in read_journal(mission.folder / "journal.jsonl")]
    assert times == sorted(times)  # simulated time goes on where it was

    # A third time: nothing left, so nothing is connected and nothing moves.
    rig = mission.rig()
    assert mission.acquire(rig).complete
    with pytest.raises(NotConnected):
        rig.background.read_temperature()


def test_stopped_before_it_begins(mission: Mission) -> None:
    rig = mission.rig()
    record = mission.acquire(rig, should_stop=lambda: True)
    assert (record.complete, record.saved) == (False, 0)
    assert events(mission.folder) == ["start", "stopped", "made safe"]
    assert_safe(rig)


@pytest.mark.parametrize("reading_K", [float("nan"), float("inf"), -5.0])
@pytest.mark.parametrize("calls", [0, 3, 400])
def test_what_is_no_temperature_ends_the_run(
    reading_K: float, calls: int, mission: Mission
) -> None:
    """Whatever driver gives it, and whenever: it is neither waited on nor taken for a drift."""
    seen = 0

    def odd(background: Any) -> dict[str, Any]:
        def read_temperature() -> float:
            nonlocal seen
            seen += 1
            return reading_K if seen > calls else float(background.read_temperature())

        return {"read_temperature": read_temperature}

    rig = mission.rig(background=odd)
    with pytest.raises(NotConnected, match=r"answered .* K to read_temperature\(\)"):
        mission.acquire(rig)
    assert seen == calls + 1
    assert rig.trigger.read_configuration()["inhibited"]


@pytest.mark.parametrize("fault", ["missing", "incomplete", "dead", "shape", "gap"])
def test_retakes_are_bounded(fault: str, mission: Mission) -> None:
    calls = 0

    def bad(camera: Any) -> dict[str, Any]:
        def read_frames(n: int, timeout_s: float) -> Iterator[Frame]:
            nonlocal calls
            calls += 1
            for frame in camera.read_frames(n, timeout_s):
                if calls <= 3:
                    yield frame
                elif fault == "incomplete":
                    yield replace(frame, complete=False)
                elif fault == "dead":
                    yield replace(frame, data=np.zeros_like(frame.data))
                elif fault == "shape":
                    yield replace(frame, data=frame.data[1:])
                elif fault == "gap":
                    yield replace(frame, frame_id=frame.frame_id + 3)

        return {"read_frames": read_frames}

    rig = mission.rig(camera=bad)
    plan = mission.plan.model_copy(update={"retakes": 2})
    if fault == "gap":  # one shot is suspect; from there the ids are continuous again
        record = mission.acquire(rig, plan)
        assert record.complete and record.rejected == 1
    else:
        with pytest.raises(RetakesExhausted, match=r"b00_inj_00: rejected 3 times.*resumes"):
            mission.acquire(rig, plan)
        assert len(pulses(mission.data)) == 2 + 3
        assert open_acquisition(mission.folder).shots[-1].id == "b00_ref_01"  # kept
        record = mission.acquire(plan=plan)  # mended
        assert record.complete and record.lost_injections == record.rejected == 3
    assert_safe(rig)


def test_stray_frames_are_flushed(mission: Mission) -> None:
    """Somebody bumps the trigger line between two shots: thrown away, and no gap is suspected."""
    flushes = 0

    def bumped(camera: Any) -> dict[str, Any]:
        def flush() -> int:
            nonlocal flushes
            flushes += 1
            return int(camera.flush()) + (flushes == 5)

        def read_frames(n: int, timeout_s: float) -> Iterator[Frame]:
            for frame in camera.read_frames(n, timeout_s):
                yield replace(frame, frame_id=frame.frame_id + (flushes >= 5))

        return {"flush": flush, "read_frames": read_frames}

    record = mission.acquire(mission.rig(camera=bumped))
    assert record.complete and record.rejected == 0


def test_numbers_of_numpy_from_a_driver_are_stored(mission: Mission) -> None:
    """Drivers of other packages pass on what their library gives; no injection is lost by that."""

    def of_camera(camera: Any) -> dict[str, Any]:
        def read_frames(n: int, timeout_s: float) -> Iterator[Frame]:
            for frame in camera.read_frames(n, timeout_s):
                number: Any = np.int64(frame.frame_id)
                time_ns: Any = np.uint64(frame.device_timestamp_ns)
                yield Frame(frame.data, number, time_ns, time_ns)

        return {"read_frames": read_frames}

    def of_background(background: Any) -> dict[str, Any]:
        return {"read_temperature": lambda: np.float32(background.read_temperature())}

    record = mission.acquire(mission.rig(camera=of_camera, background=of_background))
    assert record.complete and record.lost_injections == 0


def test_second_ctrl_c_stops_the_generator_first(mission: Mission) -> None:
    """Both presses fall into fire(): the burst is aborted, then written off, then all is safe;
    the handlers of the process are as before."""
    aborted: list[str] = []
    before = signal.getsignal(signal.SIGINT)

    def pressed(trigger: Any) -> dict[str, Any]:
        def fire() -> None:
            trigger.fire()
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)

        return {"fire": fire, "abort": lambda: aborted.append(events(mission.folder)[-1])}

    rig = mission.rig(trigger=pressed)
    with pytest.raises(Aborted, match="within a shot"):
        mission.acquire(rig)
    assert aborted == ["fired"] and events(mission.folder)[-2:] == ["lost", "made safe"]
    assert_safe(rig)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="SIGHUP is POSIX")
def test_under_nohup_a_closed_terminal_ends_nothing(mission: Mission) -> None:
    """SIGHUP is ignored then, and an acquisition of hours goes on."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        record = mission.acquire(progress=lambda _: signal.raise_signal(signal.SIGHUP))
        assert record.complete and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_in_another_thread(mission: Mission) -> None:
    """Signals belong to the main thread; elsewhere `should_stop` is the way to stop."""
    with ThreadPoolExecutor(1) as pool:
        record = pool.submit(acquire, open_rig(mission.data), mission.plan, mission.folder).result()
    assert record.complete


def test_fire_is_never_repeated_because_it_failed(mission: Mission) -> None:
    """fire() fails after the pulse went out and no frame comes: it stops, one pulse, counted."""
    shots = 0

    def failing(trigger: Any) -> dict[str, Any]:
        def fire() -> None:
            nonlocal shots
            shots += 1
            trigger.fire()
            if shots == 3:
                rig.camera.flush()
                raise FireUncertain("trigger: no answer after *TRG")

        return {"fire": fire}

    rig = mission.rig(trigger=failing)
    with pytest.raises(FireUncertain, match="no answer"):
        mission.acquire(rig)
    assert shots == 3 and len(pulses(mission.data)) == 3
    assert events(mission.folder)[-3:] == ["fired", "lost", "made safe"]
    assert_safe(rig)
    record = mission.acquire()
    assert record.complete and record.lost_injections == 1 and len(pulses(mission.data)) == 11


def test_uncertain_fire_with_a_frame_is_a_shot(mission: Mission) -> None:
    def failing(trigger: Any) -> dict[str, Any]:
        def fire() -> None:
            trigger.fire()
            raise FireUncertain("trigger: no answer after *TRG")

        return {"fire": fire}

    record = mission.acquire(mission.rig(trigger=failing))
    assert record.complete and len(pulses(mission.data)) == 10


def test_drift_before_the_shot_costs_no_injection(mission: Mission) -> None:
    """A door is opened once, between the references and the injections."""
    cold = 0

    def draughty(background: Any) -> dict[str, Any]:
        def read_temperature() -> float:
            nonlocal cold
            if (
                len(pulses(mission.data)) == 2 and cold < 2
            ):  # after the shot before, and before this
                cold += 1
                return float(background.read_temperature()) - (0.0 if cold == 1 else 1.0)
            return float(background.read_temperature())

        return {"read_temperature": read_temperature}

    record = mission.acquire(mission.rig(background=draughty))
    assert record.complete and record.rejected == 1 and record.lost_injections == 0
    assert len(pulses(mission.data)) == 10
    assert events(mission.folder).count("stable") == 3  # it waits again


def test_drift_during_the_shot_is_retaken(mission: Mission) -> None:
    def draughty(background: Any) -> dict[str, Any]:
        dropped = False

        def read_temperature() -> float:
            nonlocal dropped
            if len(pulses(mission.data)) == 3 and not dropped:
                dropped = True
                return float(background.read_temperature()) - 1.0
            return float(background.read_temperature())

        return {"read_temperature": read_temperature}

    record = mission.acquire(mission.rig(background=draughty))
    assert record.complete and record.lost_injections == 1 and len(pulses(mission.data)) == 11
