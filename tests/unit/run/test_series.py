"""A series of times: the bad ones are named, those without spray said, the others run."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.api.series import _finished
from cldit.dit.maps import Maps
from cldit.errors import (
    DiskFull,
    EmptyCloud,
    NoFuel,
    NotAtThisTime,
    SceneError,
    SprayError,
    Stopped,
)
from cldit.run.folder import open_run
from cldit.run.result import Run
from cldit.run.series import run_times
from cldit.run.series_plan import SeriesPlan
from cldit.scene import Scene, load_scene
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.seriescases import NOZZLE, write_times

WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"


def plan_of(*times: float) -> SeriesPlan:
    scene = load_scene("gdi-cone").with_(spray={"model": "cfd", "file": "none"})
    scenes = {time: scene.with_(**{"spray.time_s": time}) for time in times}
    return SeriesPlan(scenes)


class Runs:
    """Stands for `simulate`: errors by time, else a run with so much liquid; `seen` by clouds."""

    def __init__(self, liquid: float, **errors: Exception) -> None:
        self._run = open_run(WRITTEN)
        self._liquid, self._errors = liquid, errors
        self.seen: list[tuple[float, str | None]] = []
        self.said: list[str] = []

    def __call__(self, scene: Scene, folder: Path) -> Run:
        assert isinstance(scene.spray, CfdSpray)
        assert isinstance(scene.spray.time_s, float)
        self.seen.append((scene.spray.time_s, scene.spray.cloud))
        error = self._errors.get(f"at{scene.spray.time_s:g}".replace(".", "_"))
        if error is not None and scene.spray.cloud is None:
            raise error
        liquid = self._liquid if scene.spray.cloud is None else 0.0
        object.__setattr__(self._run, "folder", folder)
        self._run.info.spray.clear()
        self._run.info.spray["liquid_mass_kg"] = liquid
        return self._run


def states(plan: SeriesPlan, runs: Runs) -> list[str]:
    return [each.state for each in run_times(plan, Path("out"), runs, runs.said.append)]


def test_a_bad_time_is_named_and_the_others_run() -> None:
    runs = Runs(1e-6, at0_002=SprayError("T: is damaged"))
    done = run_times(plan_of(1e-3, 2e-3, 3e-3), Path("out"), runs, runs.said.append)
    assert [each.state for each in done] == ["done", "failed", "done"]
    assert done[1].problem == "T: is damaged"
    assert "2 ms failed: T: is damaged" in runs.said
    assert done[0].folder == Path("out/time_1ms")


def test_a_cloud_that_is_lost_in_between_is_no_spray_of_gas_alone() -> None:
    """Before the first liquid and after the last it is; what the files call empty is anywhere."""
    lost = {name: NotAtThisTime("lost") for name in ("at0_001", "at0_003", "at0_005")}
    runs = Runs(1e-6, **lost)
    times = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3)
    assert states(plan_of(*times), runs) == ["done", "done", "failed", "done", "done"]
    assert (1e-3, "none") in runs.seen and (5e-3, "none") in runs.seen
    assert (3e-3, "none") not in runs.seen
    runs = Runs(1e-6, at0_003=EmptyCloud("empty"))
    assert states(plan_of(2e-3, 3e-3, 4e-3), runs) == ["done", "done", "done"]
    assert (3e-3, "none") in runs.seen


def test_a_cloud_that_is_lost_at_all_times_is_not_taken_for_gas_alone() -> None:
    runs = Runs(1e-6, at0_001=NotAtThisTime("lost"), at0_002=NotAtThisTime("lost"))
    assert states(plan_of(1e-3, 2e-3), runs) == ["failed", "failed"]


def test_no_spray_is_said() -> None:
    runs = Runs(1e-6, at0=NoFuel("holds no fuel"))
    assert states(plan_of(0.0, 1e-3), runs) == ["no spray", "done"]
    assert "no spray at 0 ms: holds no fuel" in runs.said


@pytest.mark.parametrize("error", [Stopped("stopped"), DiskFull("full"), KeyboardInterrupt()])
def test_what_concerns_all_times_ends_them(error: BaseException) -> None:
    runs = Runs(1e-6, at0_001=error)  # type: ignore[arg-type]
    with pytest.raises(type(error)):
        states(plan_of(1e-3, 2e-3), runs)
    assert len(runs.seen) == 1


def test_degrees_of_crank_angle_stay_numbers(tmp_path: Path) -> None:
    case = write_times(tmp_path / "case", {"-12.5": 4e-5, "0.5": 1e-4})
    scene = load_scene("gdi-cone").with_(spray={"model": "cfd", "file": str(case)})
    plan = SeriesPlan.of(scene, "all")
    assert list(plan.scenes) == [-12.5, 0.5]
    assert [plan.stamp(time) for time in plan.scenes] == ["-12.5", "  0.5"]
    assert plan.folder(-12.5) == "time_-12.5"
    assert list(SeriesPlan.of(scene, "latest, nearest -12000ms").scenes) == [-12.5, 0.5]
    near = SeriesPlan.of(scene, ["nearest 1.5"])
    assert list(near.scenes) == [0.5]
    assert "Time 0.5 is the nearest to 1.5: 1 away." in near.remarks
    for time, one in plan.scenes.items():
        assert isinstance(one.spray, CfdSpray)
        assert one.spray.time_s == time
        assert one.spray.nozzle_m == pytest.approx(NOZZLE, abs=2e-4)
        assert one.plan.delays_s == ()
    assert len({one.name for one in plan.scenes.values()}) == 2


def test_times_of_a_model() -> None:
    scene = load_scene("gdi-cone")
    plan = SeriesPlan.of(scene, "1ms, 0.5ms")
    assert [one.spray.time_s for one in plan.scenes.values()] == [0.5e-3, 1e-3]  # type: ignore[union-attr]
    delays = scene.with_(**{"plan.delays_s": [0.6e-3, 0.3e-3]})
    assert list(SeriesPlan.of(delays, "all").scenes) == [0.3e-3, 0.6e-3]
    for wanted in ("all", "::2", "latest"):
        with pytest.raises(SceneError, match="cone computes any time"):
            SeriesPlan.of(scene, wanted)
    with pytest.raises(SceneError, match=r"5.*outside"):
        SeriesPlan.of(scene, [5.0])
    with pytest.raises(SceneError, match="3 of them"):
        SeriesPlan.of(scene, "1ms, 3 of them")
    with pytest.raises(SceneError, match="none is named"):
        SeriesPlan.of(scene, [])
    with pytest.raises(SceneError, match="one time only"):
        SeriesPlan.of(scene.with_(spray={"model": "none"}), "1ms")


def test_medians_are_of_the_acquired_maps() -> None:
    runs = Runs(1e-6)
    (one,) = run_times(plan_of(1e-3), Path("out"), runs, runs.said.append)
    maps = Maps.load(WRITTEN / "acquisition" / "maps")
    assert one.dit is not None
    assert one.dit.pixels == np.isfinite(maps.apparent_temperature_K).sum()


def test_a_report_older_than_its_trace_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny_scene: Scene
) -> None:
    stored: Any = SimpleNamespace(measured=object())
    monkeypatch.setattr("cldit.api.series.stored_run", lambda folder, scene: stored)
    report, trace = tmp_path / "report.html", tmp_path / "run.json"
    for path in (report, trace):
        path.touch()
    for written_ns, finished in ((999, None), (1000, stored)):
        os.utime(trace, ns=(1000, 1000))
        os.utime(report, ns=(written_ns, written_ns))
        assert _finished(tiny_scene, tmp_path) is finished
