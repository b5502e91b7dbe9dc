"""How far an acquisition is, and how long it will still take."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Approach:
    """A black body on its way: what it reads, where it goes, and how close is close enough."""

    reading_K: float
    setpoint_K: float
    tolerance_K: float

    def __str__(self) -> str:
        away_K = self.reading_K - self.setpoint_K
        within = "within" if abs(away_K) <= self.tolerance_K else "outside"
        return (
            f"black body {self.reading_K:.2f} K, set point {self.setpoint_K:g} K "
            f"({away_K:+.2f} K, {within} ±{self.tolerance_K:g} K)"
        )


@dataclass(frozen=True)
class Progress:
    """Where the sequence is. done and total count shots; eta_s is in the rig's time; approach is
    there while a background is waited for."""

    phase: str
    done: int
    total: int
    eta_s: float | None
    approach: Approach | None = None


def left_text(done: int, total: int, left_s: float | None) -> str:
    """What is left, in words: `7 of 10 shots left, 12 min`.

    Args:
        done: shots that are saved.
        total: shots of the plan.
        left_s: seconds that the rest takes; None where that is not known yet.
    """
    shots = f"{total - done} of {total} shots left"
    if done == total:
        return shots
    if left_s is None:
        return f"{shots}, time not known yet"
    minutes = round(left_s / 60.0)
    if left_s < 99.5:
        return f"{shots}, {left_s:.0f} s"
    return f"{shots}, {minutes} min" if minutes < 100 else f"{shots}, {left_s / 3600.0:.1f} h"


class Eta:
    """Time left, from what backgrounds and shots took so far."""

    def __init__(self) -> None:
        self._left = {"background": 0, "shot": 0}
        self._took_s: dict[str, list[float]] = {"background": [], "shot": []}

    def plan(self, *, backgrounds: int, shots: int) -> None:
        """Sets how many backgrounds and shots are left."""
        self._left = {"background": backgrounds, "shot": shots}

    def background(self, took_s: float) -> None:
        """One background more is reached, after `took_s`."""
        self._add("background", took_s)

    def shot(self, took_s: float) -> None:
        """One shot more is taken, after `took_s`."""
        self._add("shot", took_s)

    def _add(self, what: str, took_s: float) -> None:
        self._took_s[what].append(took_s)
        self._left[what] = max(self._left[what] - 1, 0)

    def left_s(self) -> float | None:
        """Seconds that are left; None before there is one of each."""
        if not all(self._took_s.values()):
            return None
        return sum(
            self._left[what] * sum(times) / len(times) for what, times in self._took_s.items()
        )
