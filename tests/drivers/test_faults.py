"""Faults of the simulated rig: each shows as what it stands for, and the runner copes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cldit.acquisition import Plan, Progress, acquire, open_acquisition
from cldit.acquisition.journal import read_journal
from cldit.rig.clock import SimulatedClock
from cldit.rig.errors import DeviceTimeout, FireUncertain, RetakesExhausted, RigError
from cldit.rig.load import open_rig

if TYPE_CHECKING:  # the same file, by the name under which mypy finds it
    from drivers.heater import Dynamics, Heater
else:
    from cldit.drivers.heater import Dynamics, Heater


def heater(**dynamics: float) -> tuple[Heater, SimulatedClock]:
    clock = SimulatedClock()
    made = Heater(Dynamics(**dynamics), clock, 300.0)
    made.aim(400.0)
    return made, clock


def test_slew_limits_the_way() -> None:
    """2 K/s and 10 s: a ramp of 100 - 20 K in 40 s, then exp(-t/10 s) on 20 K; and settling_time
    is when that reaches the tolerance."""
    made, _ = heater(slew_K_per_s=2.0, time_constant_s=10.0)
    assert made.temperature_K(20.0) == pytest.approx(340.0)
    assert made.temperature_K(40.0) == pytest.approx(380.0)
    assert made.temperature_K(50.0) == pytest.approx(400.0 - 20.0 / math.e)
    assert 400.0 - made.temperature_K(made.settling_time_s(100.0, 0.2)) == pytest.approx(0.2)
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


def test_never_settles_ends_in_a_timeout(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    tiny_rig["background"]["settings"].update(swing_K=3.0, stable_within_K=5.0)
    with pytest.raises(DeviceTimeout, match="not stable"):
        acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a")


@pytest.mark.parametrize("fault", ["drop", "incomplete"])
def test_frames_that_fail_are_retaken(
    fault: str, tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """A third of the frames fail: every shot is there once, each failure has its reason; and the
    same seed gives the same faults."""
    tiny_rig["camera"]["settings"][fault] = 0.33
    tiny_rig["seed"] = 4
    plan = tiny_plan.model_copy(update={"retakes": 10})
    rejected = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        record = acquire(open_rig(tiny_rig), plan, folder)
        assert record.complete and open_acquisition(folder).complete
        entries = read_journal(folder / "journal.jsonl")
        rejected.append([e["shot"] for e in entries if e["event"] == "rejected"])
        assert all("missing frame" in e["reason"] for e in entries if e["event"] == "rejected")
    assert rejected[0] == rejected[1] and len(rejected[0]) >= 1


def test_unplugged_camera_and_resume(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    tiny_rig["camera"]["settings"]["unplug_after"] = 5
    with pytest.raises(RigError, match="unplugged"):
        acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a")
    del tiny_rig["camera"]["settings"]["unplug_after"]
    assert acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a").complete


def test_failed_injections_are_retaken(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """Four in ten injections bring no fuel: each is rejected, counted, and taken again, also by a
    run that resumes with the references on the disk; with every one failing, it ends."""
    tiny_rig["trigger"]["settings"]["misfire"] = 0.4
    plan = tiny_plan.model_copy(update={"expect_fuel": True, "shots": 8, "retakes": 10})
    done = 0

    def count(progress: Progress) -> None:
        nonlocal done
        done = progress.done

    acquire(open_rig(tiny_rig), plan, tmp_path / "a", progress=count, should_stop=lambda: done > 3)
    record = acquire(open_rig(tiny_rig), plan, tmp_path / "a")
    assert record.complete and record.rejected == record.lost_injections >= 3
    entries = read_journal(tmp_path / "a" / "journal.jsonl")
    reasons = {e["reason"].partition(":")[0] for e in entries if e["event"] == "rejected"}
    assert reasons == {"failed injection"}
    acquisition = open_acquisition(tmp_path / "a")
    for background in (0, 1):
        middle = {
            kind: [acquisition.load(s)[5:7, 7:9].mean() for s in acquisition.shots
                   if s.kind == kind and s.background == background]
            for kind in ("reference", "injection")
        }  # fmt: skip
        assert max(middle["injection"]) < 0.7 * min(middle["reference"])
    tiny_rig["trigger"]["settings"]["misfire"] = 1.0
    with pytest.raises(RetakesExhausted, match="rejected 3 times, at last for failed injection"):
        acquire(open_rig(tiny_rig), plan.model_copy(update={"retakes": 2}), tmp_path / "b")


def test_rate_error_and_misfire(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    tiny_rig["trigger"]["settings"]["rate_error"] = 1.0
    with pytest.raises(FireUncertain, match="rate error"):
        acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a")
    tiny_rig["trigger"]["settings"].update(rate_error=0.0, misfire=1.0)
    acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "b")
    acquisition = open_acquisition(tmp_path / "b")
    means = {
        kind: [acquisition.load(s)[5:7, 7:9].mean() for s in acquisition.shots
               if s.kind == kind and s.background == 0]
        for kind in ("reference", "injection")
    }  # fmt: skip
    assert min(means["injection"]) > 0.9 * max(means["reference"])  # no fuel in the air
