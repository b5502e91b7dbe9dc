"""How a command ends, as a number that scripts read."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """The exit status of `cldit`."""

    DONE = 0
    FAILED = 1
    USAGE = 2  # click's
    DIFFERS = 3
    STOPPED = 130  # as shells have it for Ctrl-C

    @property
    def text(self) -> str:
        """What it says, on one line."""
        return _TEXT[self]


_TEXT = {
    Exit.DONE: "done",
    Exit.FAILED: "refused or failed; the standard error says why",
    Exit.USAGE: "the command line is not as it must be",
    Exit.DIFFERS: "diff, repeat: differs by more than the stated errors",
    Exit.STOPPED: "stopped by Ctrl-C",
}


def epilog() -> str:
    """The codes for the end of `cldit --help`; `\\b` keeps click from joining the lines."""
    lines = [f"  {code.value:<4d}{code.text}" for code in Exit]
    return "\n".join(["\b", "Exit status:", *lines])
