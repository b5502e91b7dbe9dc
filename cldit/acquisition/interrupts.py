"""Ctrl-C once: finish the shot, then stop. Twice: abort the shot."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from cldit.rig.clock import StopCheck
from cldit.rig.errors import Aborted

# What a signal is worth in presses of Ctrl-C: whoever ends the process wants it to end.
_WORTH = {
    getattr(signal, name): worth
    for name, worth in (("SIGINT", 1), ("SIGTERM", 2), ("SIGHUP", 2))
    if hasattr(signal, name)
}


class Interrupts:
    """Handles the process's signals while it is entered; outside the main thread, none. Under nohup
    a closed terminal ends nothing.

    The handler only counts. Within `abortable()`, where nothing is being written, the second press
    raises Aborted at once.
    """

    def __init__(self, should_stop: StopCheck | None = None) -> None:
        self._asked = should_stop
        self._presses = 0
        self._abortable = False
        self._before: dict[int, Any] = {}

    def should_stop(self) -> bool:
        """True if nothing new is to be begun."""
        return self._presses > 0 or (self._asked is not None and self._asked())

    @contextmanager
    def abortable(self) -> Iterator[None]:
        """Part of a shot that the second press interrupts."""
        self._abortable = True
        try:
            self._check()
            yield
        finally:
            self._abortable = False

    def _check(self) -> None:
        if self._abortable and self._presses > 1:
            self._abortable = False  # once is enough: what follows makes the rig safe
            raise Aborted("stopped within a shot; give the same command again to go on")

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._presses += _WORTH[signal.Signals(number)]
        self._check()

    def __enter__(self) -> "Interrupts":
        if threading.current_thread() is threading.main_thread():
            for number in _WORTH:
                ignored = signal.getsignal(number) is signal.SIG_IGN
                if not (ignored and signal.Signals(number).name == "SIGHUP"):  # as under nohup
                    self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
