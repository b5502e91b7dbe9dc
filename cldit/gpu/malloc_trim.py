"""Memory that was freed and that the C library keeps for later."""

from __future__ import annotations

import ctypes


def trim_heap() -> None:
    """Gives it back to the system where the library is glibc; does nothing elsewhere.

    A compiler leaves some hundred megabytes, and so does what comes before a trace.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):  # musl, macOS, Windows
        return
    trim(0)
