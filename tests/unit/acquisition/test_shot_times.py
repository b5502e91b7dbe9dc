"""When the shots of an acquisition were taken: from its journal, into the evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.acquisition.journal import Entry, shot_times
from cldit.acquisition.plan import Group
from cldit.api.folder_evaluation import evaluate_folder
from cldit.dit.drift_axis import drift_axis
from cldit.rig.load import open_rig


def test_times_of_a_journal_and_waits_for_the_black_body(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """From the hottest background down, as a rig goes that is hot: the shots of the first
    background of the plan are the last."""
    temperatures = tuple(sorted(tiny_plan.backgrounds_K, reverse=True))
    plan = tiny_plan.model_copy(update={"backgrounds_K": temperatures})
    acquire(open_rig(tiny_rig), plan, tmp_path / "a")
    shots = open_acquisition(tmp_path / "a").shots
    first, last = (
        [shot.time_s for shot in shots if shot.background == number]
        for number in (0, len(temperatures) - 1)
    )
    assert min(one or 0.0 for one in first) > max(one or 0.0 for one in last)
    assert all((shot.stable_s or 0.0) < (shot.time_s or 0.0) for shot in shots)
    axis = drift_axis(shots)
    at = [place.at for place in axis.places]
    assert not axis.breaks_s and at[0] > at[-1]
    assert np.ptp(at) > 2 * len(shots)  # waits for the black body are most of the time
    found = evaluate_folder(tmp_path / "a")
    assert found.drift_axis.startswith("drift fitted against time; ")
    assert found.drift_axis in found.lines
    assert found.to_dict()["drift_axis"] == found.drift_axis


def test_each_delay_has_its_own_times(
    rig_of_three: dict[str, Any], plan_of_three: Plan, tmp_path: Path
) -> None:
    """The black body was stable before the first delay, and drifts for longer before the last."""
    acquire(open_rig(rig_of_three), plan_of_three, tmp_path / "a")
    opened = open_acquisition(tmp_path / "a")
    since = []
    for delay in range(3):
        shots = opened.of_group(Group(delay=delay)).shots
        axis = drift_axis(shots)
        assert "drift fitted against time" in axis.text
        here = [
            place for shot, place in zip(shots, axis.places, strict=True) if not shot.background
        ]
        since.append(here[0].since)
        assert np.all(np.diff([place.at for place in here]) > 0.0)
    assert 0.0 < since[0] < since[1] < since[2]


def _entry(event: str, minute: int, shot: str = "") -> Entry:
    return {"event": event, "time": f"2026-01-01T00:{minute:02d}:00+00:00", "shot": shot}


def test_a_clock_that_was_set_back_gives_no_times() -> None:
    entries = [_entry("stable", 1), _entry("saved", 2, "a"), _entry("saved", 4, "b")]
    times = shot_times(entries)
    assert list(times) == ["a", "b"]
    assert times["b"][0] - times["a"][0] == 120.0
    assert times["a"][0] - (times["a"][1] or 0.0) == 60.0
    assert shot_times([*entries, _entry("saved", 3, "c")]) == {}
    assert shot_times([_entry("saved", 2, "a")])["a"][1] is None
