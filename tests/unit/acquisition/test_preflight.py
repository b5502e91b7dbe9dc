"""What an acquisition would refuse, the dry run refuses in the same words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cldit.acquisition import acquire, dry_run
from cldit.acquisition.plan import TriggerSection
from cldit.errors import DiskFull
from cldit.io.exclusive import exclusive
from cldit.rig.errors import OutOfLimits
from tests.wrapped import Mission, pulses, refusals

Spoil = Callable[[dict[str, Any]], Any]
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
