"""Emulator of a Thorlabs FW102C filter wheel on a loopback socket or a pseudo-terminal.

From the maker's manual and programs for it: lines that end with CR, a command that is repeated, the
prompt `> ` after each answer, and an error text for commands that it does not know. The wheel
moves in finite time, sticks, and is turned by hand.
"""

from __future__ import annotations

from cldit.rig.clock import Clock
from cldit.testing.replies import Replies
from tests.emulators.lines import AtOneLine

_IDENTITY = "THORLABS FW102C/FW212C Filter Wheel version 1.07"


class FilterWheelPeer(AtOneLine):
    """Emulated wheel, which listens at `host`:`port`, or at `serial`, once entered.

    size: its positions. clock: of the moves of `takes_s`. echo: repeats commands. waits: answers a
    move at its end; the maker does not state when. serial: replaces the socket by a
    pseudo-terminal. commands: all that were understood.
    """

    _end = b"\r"

    def __init__(
        self,
        *,
        clock: Clock | None = None,
        size: int = 6,
        takes_s: float = 0.5,
        identity: str = _IDENTITY,
        echo: bool = True,
        waits: bool = False,
        serial: bool = False,
    ) -> None:
        self.host, self.port = "127.0.0.1", 0
        self.serial: str | None = None
        self.replies = Replies()
        self.stuck = False
        self.commands: list[str] = []
        self.clock: Clock = clock or Clock()
        self._size, self._takes_s, self._identity, self._echo = size, takes_s, identity, echo
        self._position, self._before, self._there_s = 1, 1, 0.0
        self._values = {"speed": 0, "sensors": 0, "trig": 0, "baud": 1}
        self._waits = waits
        self._wants_serial = serial

    @property
    def position(self) -> int:
        """Position in front of the camera; the one before during a move."""
        moving = self.clock.now_s() < self._there_s
        return self._before if moving else self._position

    def turn(self) -> None:
        """Turns the wheel by hand, to the next position."""
        self._position = self.position % self._size + 1
        self._there_s = 0.0

    def _obey(self, line: bytes) -> bytes:
        text = line.decode("ascii", "replace").strip()
        lines = [*([text] if self._echo else []), *self._answer(text)]
        return "".join(f"{item}\r" for item in lines).encode() + b"> "

    def _answer(self, text: str) -> list[str]:
        self.commands.append(text)
        if text == "*idn?":
            return [self._identity]
        if text == "pcount?":
            return [str(self._size)]
        if text == "pos?":
            return [str(self.position)]
        name, _, value = text.partition("=")
        if name == "pos":
            return self._move(value)
        if text.endswith("?") and text[:-1] in self._values:
            return [str(self._values[text[:-1]])]
        if name in self._values:
            if value not in ("0", "1"):
                return ["Command error CMD_ARG_INVALID"]
            self._values[name] = int(value)
            return []
        self.commands.pop()
        return ["Command error CMD_NOT_DEFINED"]

    def _move(self, value: str) -> list[str]:
        if not value.isdecimal() or not 1 <= int(value) <= self._size:
            return ["Command error CMD_ARG_INVALID"]
        if not self.stuck:
            self._before, self._position = self.position, int(value)
            self._there_s = self.clock.now_s() + self._takes_s
        if self._waits:
            self.clock.sleep(self._takes_s)
        return []
