"""Waiting for what another process or thread does, however busy the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable

HANG_s = 600.0  # ends a test that hangs; a machine that stalls for half a minute is no failure


def until(condition: Callable[[], object], state: Callable[[], object] = lambda: "") -> None:
    """Waits until a condition holds; fails with the `state` if it does not."""
    end_s = time.monotonic() + HANG_s
    while not condition():
        assert time.monotonic() < end_s, state()
        time.sleep(0.005)
