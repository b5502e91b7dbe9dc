"""A rig believes no device that says nothing, or that says that it was never connected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cldit.acquisition import Plan, acquire
from cldit.rig.errors import RigError
from cldit.rig.load import open_rig
from cldit.rig.protocols import Safety
from tests.journals import read_journal
from tests.wrapped import wrapped


def silent() -> None:
    return None


def never() -> Safety:
    return Safety(connected=False, did="nothing")


@pytest.mark.parametrize(
    ("make_safe", "said"),
    [
        (silent, "returned None; allowed: a"),
        (never, "it was connected, but its make_safe() did nothing"),
    ],
)
def test_what_says_nothing_is_not_safe(
    make_safe: Any, said: str, tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """Of a silent device it is said what may still be on; the others are made safe, and all of it
    is in the journal."""
    rig = wrapped(tiny_rig, background=lambda device: {"make_safe": make_safe})
    with pytest.raises(RigError) as caught:
        acquire(rig, tiny_plan, tmp_path / "a")
    assert said in str(caught.value) and "the black body may still be hot" in str(caught.value)
    entry = read_journal(tmp_path / "a" / "journal.jsonl")[-1]
    assert entry["event"] == "unsafe" and said in entry["problems"][0]
    assert entry["did"] == {"trigger": "inhibited", "camera": "disarmed"}


def test_what_was_done_is_in_the_journal(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    for _ in range(2):  # the second time there is nothing to do, and nothing is written
        with open_rig(tiny_rig) as rig:
            assert acquire(rig, tiny_plan, tmp_path / "a").complete
    entries = read_journal(tmp_path / "a" / "journal.jsonl")
    assert [entry["event"] for entry in entries].count("made safe") == 1
    assert entries[-1]["did"] == {
        "trigger": "inhibited",
        "background": "set point 295.0 K",
        "camera": "disarmed",
    }


def test_nothing_connected_is_nothing_to_do(tiny_rig: dict[str, Any]) -> None:
    safety = open_rig(tiny_rig).make_safe()
    assert safety.did == {} and safety.problems == [] and not safety.moved
