"""Channel of an emulator's replies, on which a test can lose, damage or delay them."""

import re
import time
from enum import StrEnum


class Fault(StrEnum):
    """Fault of a reply."""

    DROP = "drop"  # the reply never arrives
    NAN = "nan"  # its data are not a number
    GARBAGE = "garbage"  # its data are other bytes; what frames them is whole
    HALF = "half"  # its end never arrives
    LATE = "late"  # it arrives after the time to wait, and delays the following ones
    FOREIGN = "foreign"  # another instrument on the line answers
    ODD = "odd"  # its numbers are impossible, as those of a broken sensor


LINE_FAULTS: list[Fault] = [fault for fault in Fault if fault is not Fault.ODD]
"""Faults of the line, which end with a newly opened one."""


TEXT_NAN = b"NAN"  # as an instrument with text commands writes it
BINARY_NAN = b"\x7f\xc0\x00\x00"  # float32, big-endian
INTEGER_NONE = b"\x80\x00"  # int16, the most negative: integers have no NaN
_TEXT_ODD, _WORD_ODD = b"32767", b"\x7f\xf0"
_NUMBER = re.compile(rb"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")
_OTHERS = b"17.3 OF ANOTHER"
_IDENTITY_COMMAS = 3  # an identity is no reading


class Replies:
    """Channel of all replies of one peer, which calls `passed` for each.

    sent: number of replies; a command without a reply does not count. struck: number of those with
    a fault. fault: of the chosen replies; None for none. no_number: replaces the data of a reply;
    if binary, it is repeated over all of them.
    """

    def __init__(self, no_number: bytes = TEXT_NAN) -> None:
        self.no_number = no_number
        self.sent = self.struck = 0
        self.fault: Fault | None = None
        self._numbers = range(0)
        self._late_s = 0.0

    def spoil(
        self, fault: Fault, first: int, *, last: int | None = None, late_s: float = 0.1
    ) -> None:
        """Sets a fault for replies `first` to `last` (by default `first` alone), counted from 1."""
        self.fault, self._late_s = fault, late_s
        self._numbers = range(first, (first if last is None else last) + 1)

    def heal(self) -> None:
        """Ends the faults."""
        self.fault = None

    def passed(self, reply: bytes, data: slice) -> bytes:
        """The part of a reply that arrives, returned when it does; `data` are its framed data."""
        self.sent += bool(reply)
        if not reply or self.fault is None or self.sent not in self._numbers:
            return reply
        self.struck += 1
        start, stop, _ = data.indices(len(reply))
        payload = reply[start:stop]
        binary = self.no_number in (BINARY_NAN, INTEGER_NONE)
        match self.fault:
            case Fault.DROP:
                return b""
            case Fault.HALF:
                return reply[: len(reply) // 2]
            case Fault.LATE:
                time.sleep(self._late_s)
                return reply
            case Fault.NAN if binary:
                payload = (self.no_number * len(payload))[: len(payload)]
            case Fault.NAN:
                payload = self.no_number
            case Fault.FOREIGN if not binary:  # else its peer, who knows the address, changes it
                payload = _OTHERS
            case Fault.ODD if binary:
                payload = (_WORD_ODD * len(payload))[: len(payload)]
            case Fault.ODD if payload.count(b",") != _IDENTITY_COMMAS:
                payload = _NUMBER.sub(_TEXT_ODD, payload)
            case Fault.GARBAGE:
                payload = bytes(byte ^ 0xA5 for byte in payload)
        return reply[:start] + payload + reply[stop:]
