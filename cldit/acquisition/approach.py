"""Journal entries of a black body approaching its set point: as many readings as a curve needs."""

from __future__ import annotations

from cldit.acquisition.journal import Journal
from cldit.acquisition.progress import Approach
from cldit.rig.clock import Clock

_EVERY_s = 10.0  # a reading at least, also where nothing moves
_STEP = 0.05  # of what was left to go: a first-order approach over 100 K has some 60 steps


class ApproachLog:
    """Writes readings of one approach, as `approaching` lines.

    A line is written where the temperature moved by the tolerance and by a twentieth of what was
    left, or after 10 s: 6 lines a minute and some more while it moves fast.
    """

    def __init__(self, journal: Journal, clock: Clock) -> None:
        self._journal = journal
        self._clock = clock
        self._noted: tuple[float, float] | None = None  # when, and what it read

    def note(self, approach: Approach) -> None:
        """Adds one reading; raises as `Journal.append`."""
        now_s = self._clock.now_s()
        if self._noted is not None:
            then_s, before_K = self._noted
            step_K = _STEP * abs(before_K - approach.setpoint_K)
            moved = abs(approach.reading_K - before_K) >= max(approach.tolerance_K, step_K)
            if not moved and now_s - then_s < _EVERY_s:
                return
        self._noted = (now_s, approach.reading_K)
        self._journal.append(
            "approaching",
            time=self._clock.wall_time(),
            sync=False,  # a power cut may take the curve's last points
            background_K=approach.setpoint_K,
            reading_K=approach.reading_K,
        )
