"""What becomes of a peer's replies on their way: lost, spoiled or late, as a test asks for it."""

from __future__ import annotations

import time
from enum import StrEnum


class Fault(StrEnum):
    """What befalls a reply."""

    DROP = "drop"  # it never arrives
    NAN = "nan"  # its data are no number
    GARBAGE = "garbage"  # its data are other bytes; what frames them is whole
    HALF = "half"  # its end never arrives
    LATE = "late"  # it arrives when nobody waits for it any more, and holds up what follows


TEXT_NAN = b"NAN"  # as an instrument with text commands writes it
BINARY_NAN = b"\x7f\xc0\x00\x00"  # float32, big-endian
INTEGER_NONE = b"\x80\x00"  # int16, the most negative: integers have no NaN


class Replies:
    """The way of all replies of one peer, which calls `passed` for each.

    Attributes:
        sent: replies so far; a command without a reply does not count.
        struck: those of them that a fault befell.
        no_number: what stands in for a reply's data; binary, it is repeated over all of them.
    """

    def __init__(self, no_number: bytes = TEXT_NAN) -> None:
        self.no_number = no_number
        self.sent = self.struck = 0
        self._fault: Fault | None = None
        self._numbers = range(0)
        self._late_s = 0.0

    def spoil(
        self, fault: Fault, first: int, *, last: int | None = None, late_s: float = 0.1
    ) -> None:
        """From now on `fault` befalls some replies.

        Args:
            fault: which.
            first, last: replies, counted from 1; `first` alone where `last` is left out.
            late_s: by how much one that is late is late.
        """
        self._fault, self._late_s = fault, late_s
        self._numbers = range(first, (first if last is None else last) + 1)

    def heal(self) -> None:
        """No more faults."""
        self._fault = None

    def passed(self, reply: bytes, data: slice) -> bytes:
        """What of `reply` arrives; returns when it does.

        Args:
            reply: as it was sent.
            data: where the reply's data are; the rest frames them.
        """
        if not reply:
            return reply
        self.sent += 1
        if self._fault is None or self.sent not in self._numbers:
            return reply
        self.struck += 1
        start, stop, _ = data.indices(len(reply))
        match self._fault:
            case Fault.DROP:
                return b""
            case Fault.HALF:
                return reply[: len(reply) // 2]
            case Fault.LATE:
                time.sleep(self._late_s)
                return reply
            case Fault.NAN:
                instead = self.no_number
                if instead in (BINARY_NAN, INTEGER_NONE):
                    instead = (instead * (stop - start))[: stop - start]
                return reply[:start] + instead + reply[stop:]
            case Fault.GARBAGE:
                return reply[:start] + bytes(b ^ 0xA5 for b in reply[start:stop]) + reply[stop:]
