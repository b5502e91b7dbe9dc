"""A pseudo-terminal with text lines, as the serial line of a peer."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable

from cldit.testing.replies import Replies

from .line_server import TEXT


class Terminal:
    """Answers lines at the terminal `name` from when it is made.

    Args:
        answer: what goes back for a line, nothing for a command that has no answer.
        replies: the way of those answers.
    """

    def __init__(self, answer: Callable[[bytes], bytes], replies: Replies) -> None:
        self._answer, self._replies = answer, replies
        self._master, self._slave = os.openpty()
        for handle in (self._master, self._slave):
            tty.setraw(handle)
        self.name = os.ttyname(self._slave)
        self._on = True
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        waiting = b""
        while self._on:
            try:
                if not select.select([self._master], [], [], 0.02)[0]:
                    continue
                waiting += os.read(self._master, 4096)
                while b"\n" in waiting:
                    line, _, waiting = waiting.partition(b"\n")
                    os.write(self._master, self._replies.passed(self._answer(line), TEXT))
            except OSError:  # nobody has the other end open
                time.sleep(0.02)

    def close(self) -> None:
        """Ends it; the handles are closed when no thread reads them any more."""
        self._on = False
        self._reader.join(10.0)
        os.close(self._master)
        os.close(self._slave)
