"""Faults of the simulated rig: each shows as what it stands for, and the runner copes."""

from __future__ import annotations

from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cldit.acquisition import acquire, open_acquisition
from cldit.rig.clock import SimulatedClock
from cldit.rig.drivers import RigContext
from cldit.rig.errors import FireUncertain, RetakesExhausted, RigError
from cldit.rig.load import open_rig
from tests.journals import read_journal
from tests.wrapped import Mission

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.simulated_scene import Pulse, open_bench
else:
    from cldit.drivers.simulated_scene import Pulse, open_bench


@pytest.mark.parametrize("fault", ["drop", "incomplete"])
def test_frames_that_fail_are_retaken(fault: str, mission: Mission, tmp_path: Path) -> None:
    """A third of the frames fail: every shot is there once, each failure has its reason; and the
    same seed gives the same faults."""
    mission.data["camera"]["settings"][fault] = 0.33
    mission.data["seed"] = 4
    plan = mission.plan.model_copy(update={"retakes": 10})
    rejected = []
    for folder in (mission.folder, tmp_path / "b"):
        record = acquire(open_rig(mission.data), plan, folder)
        assert record.complete and open_acquisition(folder).complete
        entries = read_journal(folder / "journal.jsonl")
        rejected.append([e["shot"] for e in entries if e["event"] == "rejected"])
        assert all("missing frame" in e["reason"] for e in entries if e["event"] == "rejected")
    assert rejected[0] == rejected[1] and len(rejected[0]) >= 1


@pytest.mark.parametrize(("device", "after"), [("camera", 5), ("background", 400), ("trigger", 4)])
def test_unplugged_and_resume(device: str, after: int, mission: Mission) -> None:
    """Somewhere between two shots, or while a background settles: it is said which device is gone
    and what may still be on; plugged in again, the same call completes."""
    mission.data[device]["settings"]["unplug_after"] = after
    with pytest.raises(RigError, match="unplugged") as caught:
        mission.acquire()
    assert f"{device}: " in str(caught.value)
    taken = len(open_acquisition(mission.folder).shots)
    assert taken >= (0 if device == "background" else 3)
    del mission.data[device]["settings"]["unplug_after"]
    record = mission.acquire()
    assert record.complete and record.lost_injections <= 1


def test_window_glows(tiny_rig: dict[str, Any]) -> None:
    """A hot front window adds its own light, e B(T), and hides nothing else that changed."""
    settings = tiny_rig["bench"]["settings"]
    window = {"side": "front", "material": "sapphire", "thickness_m": 0.02}
    seen, behind = [], []
    for kelvin in (350.0, 400.0):
        settings["windows"] = [{**window, "temperature_K": kelvin}]
        bench = open_bench(settings, RigContext(SimulatedClock(), None, Path(), 1))
        bench.attach_blackbody(lambda time_s: 480.0)
        image = bench.radiance(Pulse(0.0, False, 1))
        (boundary,) = bench._opened[0].boundaries
        front = boundary.front
        own = front.emission * boundary.radiance(kelvin)
        reflected = front.reflection * boundary.radiance(295.0)
        seen.append(image[0, 0])
        behind.append((image - own - reflected) / front.transmission)
    assert seen[1] > 1.004 * seen[0]  # an emissivity of half a percent, at 400 K before 420 K
    assert behind[1] == pytest.approx(behind[0], rel=1e-6)


def test_injector_scatter_in_the_rig_file(tiny_rig: dict[str, Any]) -> None:
    spread = []
    for scatter in (0.0, 0.5):
        settings = {**tiny_rig["bench"]["settings"], "shot_scatter": scatter}
        bench = open_bench(settings, RigContext(SimulatedClock(), None, Path(), 1))
        bench.attach_blackbody(lambda time_s: 480.0)
        spread.append(np.std([bench.radiance(Pulse(float(n), True, n))[6, 8] for n in range(20)]))
    assert spread[0] == 0.0 < spread[1]


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_clock_that_jumps(jump_s: float, mission: Mission, tmp_path: Path) -> None:
    """Somebody sets the computer's date in the middle: nothing waits an hour more or less, every
    shot is there once, and a stopped run resumes."""
    plain, jumpy = dict(mission.data), dict(mission.data)
    jumpy["clock"] = {"model": "simulated", "jump_after_s": 500.0, "jump_s": jump_s}
    took = []
    for number, data in enumerate((plain, jumpy)):
        rig = open_rig(data)
        acquire(rig, mission.plan, tmp_path / str(number))
        took.append(rig.clock.now_s())
    assert took[0] == pytest.approx(took[1], abs=60.0)  # readings are drawn anew after the jump
    entries = read_journal(tmp_path / "1" / "journal.jsonl")
    times = [datetime.fromisoformat(e["time"]).timestamp() for e in entries]
    jumps = [after - before for before, after in pairwise(times)]
    assert (max(jumps) if jump_s > 0 else -min(jumps)) > 2000.0
    assert open_acquisition(tmp_path / "1").complete
    pictures = open_acquisition(tmp_path / "1")
    assert len({pictures.load(shot).tobytes() for shot in pictures.shots}) == 10
    resumed = Mission(jumpy, mission.plan, tmp_path / "2")
    resumed.acquire(stop_after=7)
    assert resumed.acquire().complete


def test_failed_injections_are_retaken(mission: Mission, tmp_path: Path) -> None:
    """Four in ten injections bring no fuel: each is rejected, counted, and taken again, also by a
    run that resumes with the references on the disk; with every one failing, it ends."""
    mission.data["trigger"]["settings"]["misfire"] = 0.4
    plan = mission.plan.model_copy(update={"expect_fuel": True, "shots": 8, "retakes": 10})
    mission.acquire(plan=plan, stop_after=4)
    record = mission.acquire(plan=plan)
    assert record.complete and record.rejected == record.lost_injections >= 3
    entries = read_journal(mission.folder / "journal.jsonl")
    reasons = {e["reason"].partition(":")[0] for e in entries if e["event"] == "rejected"}
    assert reasons == {"failed injection"}
    acquisition = open_acquisition(mission.folder)
    for background in (0, 1):
        middle = {
            kind: [acquisition.load(s)[5:7, 7:9].mean() for s in acquisition.shots
                   if s.kind == kind and s.background == background]
            for kind in ("reference", "injection")
        }  # fmt: skip
        assert max(middle["injection"]) < 0.7 * min(middle["reference"])
    mission.data["trigger"]["settings"]["misfire"] = 1.0
    with pytest.raises(RetakesExhausted, match="rejected 3 times, at last for failed injection"):
        acquire(open_rig(mission.data), plan.model_copy(update={"retakes": 2}), tmp_path / "b")


def test_rate_error_and_misfire(mission: Mission, tmp_path: Path) -> None:
    mission.data["trigger"]["settings"]["rate_error"] = 1.0
    with pytest.raises(FireUncertain, match="rate error"):
        mission.acquire()
    mission.data["trigger"]["settings"].update(rate_error=0.0, misfire=1.0)
    acquire(open_rig(mission.data), mission.plan, tmp_path / "b")
    acquisition = open_acquisition(tmp_path / "b")
    means = {
        kind: [acquisition.load(s)[5:7, 7:9].mean() for s in acquisition.shots
               if s.kind == kind and s.background == 0]
        for kind in ("reference", "injection")
    }  # fmt: skip
    assert min(means["injection"]) > 0.9 * max(means["reference"])  # no fuel in the air
