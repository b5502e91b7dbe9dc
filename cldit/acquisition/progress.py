"""How far an acquisition is, and how long it will still take."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Where the sequence is. done and total count shots; eta_s is in the rig's time."""

    phase: str
    done: int
    total: int
    eta_s: float | None


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
