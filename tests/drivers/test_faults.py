"""Faults of the simulated rig: each shows as what it stands for, and the runner copes."""

from __future__ import annotations

import math
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cldit.acquisition import acquire, open_acquisition
from cldit.rig.clock import SimulatedClock
from cldit.rig.drivers import RigContext
from cldit.rig.errors import DeviceTimeout, FireUncertain, RetakesExhausted, RigError
from cldit.rig.load import open_rig
from cldit.rig.protocols import TriggerInfo, TriggerMode
from tests.journals import read_journal
from tests.wrapped import Mission

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.heater import Dynamics, Heater
    from drivers.simulated_scene import Pulse, open_bench
else:
    from cldit.drivers.heater import Dynamics, Heater
    from cldit.drivers.simulated_scene import Pulse, open_bench


def heater(**dynamics: float) -> tuple[Heater, SimulatedClock]:
    clock = SimulatedClock()
    made = Heater(Dynamics(**dynamics), clock, 300.0)
    made.aim(400.0)
    return made, clock


def test_slew_limits_the_way() -> None:
    """2 K/s and 10 s: a ramp of 100 - 20 K in 40 s, then exp(-t/10 s) on 20 K."""
    made, _ = heater(slew_K_per_s=2.0, time_constant_s=10.0)
    assert made.temperature_K(20.0) == pytest.approx(340.0)
    assert made.temperature_K(40.0) == pytest.approx(380.0)
    assert made.temperature_K(50.0) == pytest.approx(400.0 - 20.0 / math.e)
    assert made.temperature_K(40.0 + 10.0 * math.log(100.0)) == pytest.approx(400.0 - 0.2)
    steps = [made.temperature_K(0.1 * (i + 1)) - made.temperature_K(0.1 * i) for i in range(1000)]
    assert 0.0 < min(steps) and max(steps) <= 0.2 + 1e-9


def test_overshoot_drift_and_swing() -> None:
    over, _ = heater(time_constant_s=10.0, overshoot=0.05)
    # The bump's maximum, 5 % of the step, is four time constants after the start.
    assert max(over.temperature_K(0.1 * i) for i in range(2000)) == pytest.approx(403.5, abs=0.5)
    assert over.temperature_K(300.0) == pytest.approx(400.0, abs=1e-3)
    drift, _ = heater(time_constant_s=10.0, drift_K_per_hour=1.0)
    assert drift.temperature_K(7200.0) == pytest.approx(402.0)
    swing, _ = heater(time_constant_s=10.0, swing_K=3.0, swing_period_s=60.0)
    late = [swing.temperature_K(600.0 + i) for i in range(60)]
    assert max(late) == pytest.approx(403.0, abs=0.02)
    assert min(late) == pytest.approx(397.0, abs=0.02)


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


def test_camera_warms_up(mission: Mission) -> None:
    """Preflight waits for the cooler; whoever does not wait gets counts on top."""
    mission.data["camera"]["settings"].update(warm_up_s=300.0, warm_up_counts=3000.0)
    rig = open_rig(mission.data)
    rig.connect()
    with pytest.raises(DeviceTimeout, match="cooler needs 200 s more"):
        rig.camera.wait_ready(100.0)

    def taken() -> float:
        rig.camera.prepare(TriggerInfo(TriggerMode.SOFTWARE))
        rig.camera.arm()
        rig.camera.software_trigger()
        (frame,) = rig.camera.read_frames(1, 1.0)
        rig.camera.disarm()
        return float(np.median(frame.data))

    warm = taken()
    rig.camera.wait_ready(1000.0)
    assert rig.clock.now_s() >= 300.0
    assert warm - taken() == pytest.approx(3000.0, abs=60.0)  # noise: some 20 counts a pixel
    fresh = open_rig(mission.data)
    assert mission.acquire(fresh).complete
    first = next(e for e in read_journal(mission.folder / "journal.jsonl") if e["event"] == "start")
    assert first["time"] >= "2000-01-01T00:05:00"


def test_non_uniformity_is_a_pattern_of_the_chip(tiny_rig: dict[str, Any]) -> None:
    """The same in every picture, with the spread that was asked for; another seed, another one."""
    gains: list[Any] = []
    for seed in (1, 1, 2):
        pictures = []
        for spread in (0.0, 0.1):
            tiny_rig["seed"] = seed
            tiny_rig["camera"]["settings"]["gain_spread"] = spread
            rig = open_rig(tiny_rig)
            rig.connect()
            rig.camera.prepare(TriggerInfo(TriggerMode.INTERNAL, n_frames=50))
            rig.camera.arm()
            pictures.append(np.mean([f.data for f in rig.camera.read_frames(50, 1.0)], axis=0))
        offset = rig.camera.read_configuration()["calibration"]["offset_counts"]
        wall = pictures[0][0] - offset  # the top row sees walls alone
        gains.append((pictures[1][0] - offset) / wall)
    assert np.allclose(gains[0], gains[1], atol=0.02)
    assert not np.allclose(gains[0], gains[2], atol=0.02)
    # 16 pixels: the spread is known to 1/sqrt(2 N) = 18 %, four of that.
    assert np.std(gains[0]) == pytest.approx(0.1, rel=0.7)


def test_window_glows(tiny_rig: dict[str, Any]) -> None:
    """A hot front window adds its own light, e B(T), and hides nothing else that changed."""
    settings = tiny_rig["bench"]["settings"]
    settings["windows"] = [
        {"side": "front", "material": "sapphire", "thickness_m": 0.02, "temperature_K": 350.0}
    ]
    seen, behind = [], []
    for heating, kelvin in ((0.0, 350.0), (50.0, 400.0)):
        settings["window_heating_K"] = heating
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
