"""A rig believes no device that says nothing, or that says that it was never connected."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.acquisition import Plan, acquire
from cldit.rig.clock import SimulatedClock
from cldit.rig.errors import NotSafe, RigError
from cldit.rig.load import open_rig
from cldit.rig.protocols import Safety
from cldit.rig.stability import watch_cooling
from tests.journals import read_journal
from tests.wrapped import wrapped


def silent() -> None:
    return None


def never() -> Safety:
    return Safety(connected=False, did="nothing")


@pytest.mark.parametrize(
    ("make_safe", "problem"),
    [
        (silent, "returned None; allowed: a"),
        (never, "it was connected, but its make_safe() did nothing"),
    ],
)
def test_what_says_nothing_is_not_safe(
    make_safe: Any, problem: str, tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """Of a silent device it is said what may still be on; the others are made safe, and all of it
    is in the journal."""
    rig = wrapped(tiny_rig, background=lambda device: {"make_safe": make_safe})
    with pytest.raises(RigError) as caught:
        acquire(rig, tiny_plan, tmp_path / "a")
    assert problem in str(caught.value) and "the black body may still be hot" in str(caught.value)
    entry = read_journal(tmp_path / "a" / "journal.jsonl")[-1]
    assert entry["event"] == "unsafe" and problem in entry["problems"][0]
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
        "background": entries[-1]["did"]["background"],
        "camera": "disarmed",
    }
    cooled = re.fullmatch(
        r"set point 295\.0 K, temperature 4\d\d\.\d K; falls to (\d+\.\d) K",
        entries[-1]["did"]["background"],
    )
    assert cooled is not None and 440.0 < float(cooled[1]) < 480.0


class Body:
    """A black body whose temperature is a function of the time since it was made safe."""

    def __init__(self, temperature_K: Callable[[float], float], noise_K: float = 0.0) -> None:
        self.clock = SimulatedClock()
        self._temperature_K = temperature_K
        self._noise = np.random.default_rng(1)
        self._noise_K = noise_K

    def read_temperature(self) -> float:
        noise_K = float(self._noise.normal(0.0, self._noise_K)) if self._noise_K else 0.0
        return self._temperature_K(self.clock.now_s()) + noise_K


def decay(start_K: float, time_constant_s: float) -> Callable[[float], float]:
    return lambda time_s: 295.0 + (start_K - 295.0) * math.exp(-time_s / time_constant_s)


@pytest.mark.parametrize(
    ("temperature_K", "actions"),
    [
        (lambda time_s: 299.0, r"^cold at 299\.0 K$"),
        (decay(440.0, 120.0), r"^falls to 43\d\.\d K$"),
        # The excess falls by 1 % within 60 s if the time constant is below 60 s / 0.01 = 6,000 s,
        # less the 4.5 s of a mean at either end.
        (decay(440.0, 5000.0), "^falls to"),
        (lambda time_s: decay(440.0, 60.0)(abs(time_s - 20.0)), "^falls to"),  # rises for 20 s
    ],
    ids=["cold", "cools", "cools slowly", "rises, then cools"],
)
def test_a_body_that_cools(temperature_K: Callable[[float], float], actions: str) -> None:
    body = Body(temperature_K)
    assert re.search(actions, watch_cooling(body, body.clock, 295.0))


@pytest.mark.parametrize(
    "temperature_K",
    [
        lambda time_s: 440.0 + 20.0 * (1.0 - math.exp(-time_s / 30.0)),
        lambda time_s: 440.0,
        lambda time_s: 310.0,
    ],
    ids=["manual output", "on hold", "another unit"],
)
def test_a_body_that_does_not_cool(temperature_K: Callable[[float], float]) -> None:
    """Within a minute of the clock, though each reading has a noise of 0.3 K."""
    body = Body(temperature_K, noise_K=0.3)
    with pytest.raises(NotSafe, match=r"does not cool: .* after 60 s; is it in manual output"):
        watch_cooling(body, body.clock, 295.0)
    assert body.clock.now_s() == pytest.approx(60.0, abs=0.6)


def test_a_body_in_manual_output_is_loud(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It confirms its safe set point, and is said to be unsafe; the journal has both."""
    rig = open_rig(tiny_rig)
    monkeypatch.setattr(rig.background, "read_temperature", lambda: 480.0)
    with pytest.raises(
        RigError, match=r"set point 295\.0 K, temperature 480\.0 K, but it does not"
    ):
        acquire(rig, tiny_plan, tmp_path / "a")
    entry = read_journal(tmp_path / "a" / "journal.jsonl")[-1]
    assert entry["event"] == "unsafe" and entry["did"]["background"].startswith("set point")


def test_nothing_connected_is_nothing_to_do(tiny_rig: dict[str, Any]) -> None:
    safety = open_rig(tiny_rig).make_safe()
    assert safety.did == {} and safety.problems == [] and not safety.moved
