"""Clocks of a rig: the computer's, and a simulated one on which two hours pass in seconds."""

import math
import time
from collections.abc import Callable
from datetime import UTC, datetime

StopCheck = Callable[[], bool]

_SLICE_S = 0.05  # longest time for which a sleep ignores a stop


class Clock:
    """Source of time for a rig: the computer's clock."""

    def now_s(self) -> float:
        """Monotonic time, seconds from an arbitrary start."""
        return time.monotonic()

    def epoch_s(self) -> float:
        """Wall time, seconds since 1970-01-01T00:00Z."""
        return time.time()

    def wall_time(self) -> str:
        """Wall time as ISO 8601 in UTC."""
        return datetime.fromtimestamp(self.epoch_s(), UTC).isoformat(timespec="microseconds")

    def sleep(self, seconds: float, should_stop: StopCheck | None = None) -> bool:
        """Waits for `seconds`; returns False if `should_stop` ended the wait early."""
        end_s = time.monotonic() + seconds
        while not (should_stop is not None and should_stop()):
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return True
            time.sleep(min(left_s, _SLICE_S) if should_stop is not None else left_s)
        return False

    def catch_up(self, epoch_s: float) -> None:
        """Called when a sequence resumes: later events are not before this wall time. Real time
        has passed meanwhile."""


_START_EPOCH_S = datetime(2000, 1, 1, tzinfo=UTC).timestamp()  # the same in every run


class SimulatedClock(Clock):
    """A clock that advances only while somebody sleeps on it.

    Args:
        real_time_factor: None: sleeping takes no time; 1: real time; 60: a minute in a second.
        jump_after_s, jump_s: a fault: after `jump_after_s` the wall time jumps by `jump_s`, as if
            somebody had set the computer's clock. Monotonic time continues.
    """

    def __init__(
        self,
        *,
        real_time_factor: float | None = None,
        jump_after_s: float | None = None,
        jump_s: float = 0.0,
    ) -> None:
        self._elapsed_s = 0.0
        self._factor = real_time_factor
        self._jump_after_s = math.inf if jump_after_s is None else jump_after_s
        self._jump_s = jump_s

    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self._elapsed_s

    def epoch_s(self) -> float:
        """Simulated seconds since 1970, including the jump."""
        jump_s = self._jump_s if self._elapsed_s >= self._jump_after_s else 0.0
        return _START_EPOCH_S + self._elapsed_s + jump_s

    def sleep(self, seconds: float, should_stop: StopCheck | None = None) -> bool:
        """Lets `seconds` pass; returns False if `should_stop` ended the wait early."""
        if should_stop is not None and should_stop():
            return False
        if self._factor is None:
            self._elapsed_s += max(seconds, 0.0)
            return True
        start_s = time.monotonic()
        completed = super().sleep(seconds / self._factor, should_stop)
        slept = seconds if completed else (time.monotonic() - start_s) * self._factor
        self._elapsed_s += min(max(slept, 0.0), max(seconds, 0.0))
        return completed

    def catch_up(self, epoch_s: float) -> None:
        """Advances to `epoch_s` if that is later."""
        self._elapsed_s = max(self._elapsed_s, epoch_s - _START_EPOCH_S)
