"""Live images for a callback that may be slow: images that it cannot keep up with are dropped."""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Preview(Generic[T]):
    """Hands the newest item to `callback`, in a thread of its own, while it is entered.

    shown, dropped: items that reached the callback, and those that a newer one replaced. error:
    raised by the callback, which is not called again after it.
    """

    def __init__(self, callback: Callable[[T], None]) -> None:
        self._callback = callback
        self._changed = threading.Condition()
        self._newest: list[T] = []
        self._ended = False
        self.shown = self.dropped = 0
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="preview", daemon=True)

    @property
    def ended(self) -> bool:
        """True if the callback has returned from its last item and gets no more."""
        return not self._thread.is_alive()

    def offer(self, item: T) -> None:
        """Never waits for the callback."""
        with self._changed:
            self.dropped += len(self._newest)
            self._newest = [item]
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest or self._ended)
                if not self._newest:
                    return
                item = self._newest.pop()
            if self.error is None:
                try:
                    self._callback(item)
                    self.shown += 1
                except Exception as error:  # a broken preview must not end an acquisition
                    self.error = error

    def __enter__(self) -> "Preview[T]":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(2.0)
