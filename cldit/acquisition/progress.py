"""Progress of an acquisition, and the time left."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Approach:
    """A black body on its way: its reading, its set point, and the tolerance."""

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
    """State of the sequence. done and total count shots; eta_s is in the rig's time; approach is
    set while a background is awaited.
    """

    phase: str
    done: int
    total: int
    eta_s: float | None
    approach: Approach | None = None


def left_text(done: int, total: int, left_s: float | None) -> str:
    """Remaining work in words: `7 of 10 shots left, 12 min`; `left_s` is None while unknown."""
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

    def add(self, stage: Literal["background", "shot"], took_s: float) -> None:
        """Counts one more background that was reached, or shot that was taken, after `took_s`."""
        self._took_s[stage].append(took_s)
        self._left[stage] = max(self._left[stage] - 1, 0)

    def left_s(self) -> float | None:
        """Seconds left; None before there is one of each."""
        if not all(self._took_s.values()):
            return None
        return sum(
            self._left[stage] * sum(times) / len(times) for stage, times in self._took_s.items()
        )
