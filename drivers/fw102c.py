"""Thorlabs FW102C and FW212C filter wheels: serial commands at 115200 8N1 over USB, or TCP.

Commands: Thorlabs, FW102C manual, rev. H, table 5.2.3; echo and prompt: as public drivers of the
wheel read them. The wheel repeats a command, ends lines
with CR, and ends an answer with the prompt `> `. Read here up to `>`, an answer begins with its own
question, so a late one is never taken for another's. A wheel that does not repeat commands is
accepted too: its first answer, which is unique, shows it.

`pos?` is the position by the wheel's own controller. The table does not state if that is the old or
the new one during a move, so it counts only `moving_s` after a command.
"""

import re
from dataclasses import replace
from typing import Annotated, Any

from cldit.rig.checks import check_filter
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, DeviceTimeout, NotConnected, OddAnswer
from cldit.rig.link import HarmlessLink
from cldit.rig.protocols import DeviceInfo, SpectralFilter, SpectralFilters
from cldit.scene.checks import Within

from .line_address import LineAddress
from .scpi import ScpiInstrument

ABOUT = DriverAbout(
    "filter_wheel",
    "Thorlabs FW102C/FW212C filter wheels, serial or TCP",
    "untested on hardware; tested with a simulator, without an independent peer",
    needs=("pyvisa", "pyvisa_py", "serial"),
)

_IDENTITY = re.compile(r"THORLABS (FW\d+C\S*) .*?(\S+)", re.IGNORECASE)
_EXPECTED = "an FW102C or FW212C"
_REFUSAL = "Command error"
_SIZES = (6, 12)  # positions of a wheel


class WheelSettings(LineAddress):
    filters: SpectralFilters
    moving_s: Annotated[float, Within(0.0, 60.0)] = 5.0  # longest move, by which it must be over
    fast: bool = True
    sensors: bool = True  # of its position stay on while idle, to notice a hand; false: less light
    port: Annotated[int, Within(1, 65535)] = 10001
    baudrate: Annotated[int, Within(9600, 115_200)] = 115_200
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0


class Fw102c(HarmlessLink, ScpiInstrument):
    """Implements `cldit.rig.protocols.FilterWheel`."""

    def __init__(self, settings: WheelSettings, context: RigContext) -> None:
        super().__init__(
            DeviceInfo("filter_wheel", "Thorlabs", "FW102C", tested_on_hardware=False),
            settings,
            by_hand="",
            baudrate=settings.baudrate,
            write_termination="\r",
            read_termination=">",
        )
        self._settings = settings
        self._clock = context.clock
        self._echoes = True

    def _identify(self) -> None:
        def parse(answer: str) -> DeviceInfo | None:
            lines = _lines(answer)
            match = _IDENTITY.fullmatch(lines[-1]) if lines else None
            if match is None:
                if lines[:1] == ["*idn?"]:
                    raise self._odd("*idn?", lines, _EXPECTED)
                return None  # late, for another program
            self._echoes = lines[0] == "*idn?"
            return replace(self._info, model=match[1], firmware=match[2])

        self._info = self._line.first("*idn?", parse, _EXPECTED)

    def _prepare(self) -> None:
        size = self._number("pcount?", _SIZES)
        for item in self._settings.filters:
            if item.position > size:
                raise ConfigRejected(
                    f"filter_wheel: filters: {item.name}: position {item.position}; allowed: "
                    f"1..{size}, the positions of this wheel"
                )
        # The trigger connector is an output: as an input, a pulse would move the wheel.
        fixed = {"trig": 1, "speed": self._settings.fast, "sensors": self._settings.sensors}
        for name, value in ((name, int(value)) for name, value in fixed.items()):
            self._tell(f"{name}={value}")
            if (got := self._number(f"{name}?", (0, 1))) != value:
                raise ConfigRejected(
                    f"filter_wheel: {name} reads back {got} after {value} was written"
                )

    @property
    def filters(self) -> tuple[SpectralFilter, ...]:
        return self._settings.filters

    @property
    def moving_s(self) -> float:
        return self._settings.moving_s

    def read_configuration(self) -> dict[str, Any]:
        return {**self._settings.model_dump(mode="json"), "position": self._position()}

    def move(self, name: str) -> None:
        target = check_filter({item.name: item.position for item in self.filters}, name)
        if self._position() == target:
            return
        self._tell(f"pos={target}", more_s=self.moving_s)  # the prompt may come at its end
        self._clock.sleep(self.moving_s)
        if (got := self._position()) != target:
            raise DeviceTimeout(
                f"filter_wheel: is at position {got} {self.moving_s:g} s after {target} ({name}) "
                "was asked; is it stuck, or slower than moving_s?"
            )

    def read_filter(self) -> str | None:
        position = self._position()
        return next((item.name for item in self.filters if item.position == position), None)

    def _position(self) -> int:
        return self._number("pos?", range(1, max(_SIZES) + 1))

    # One command, one answer

    def _tell(self, command: str, *, more_s: float = 0.0) -> None:
        def parse(answer: str) -> None:
            if lines := self._values(command, answer):
                raise self._odd(command, lines, "no value")

        self._line.ask(command, parse, more_s=more_s)

    def _number(self, query: str, allowed: "range | tuple[int, ...]") -> int:
        def parse(answer: str) -> int:
            lines = self._values(query, answer)
            if len(lines) != 1 or not lines[0].isdecimal() or int(lines[0]) not in allowed:
                raise self._odd(query, lines, f"one of {', '.join(map(str, allowed))}")
            return int(lines[0])

        return self._line.ask(query, parse)

    def _values(self, command: str, answer: str) -> list[str]:
        """Lines of an answer without the repeated command; raises OddAnswer if that is another
        one, and ConfigRejected if the wheel refuses."""
        lines = _lines(answer)
        if self._echoes:
            if not lines or lines[0] != command:
                raise self._odd(command, lines, "the command repeated")
            lines = lines[1:]
        if lines and lines[0].startswith(_REFUSAL):
            raise ConfigRejected(f"filter_wheel: rejects {command} ({lines[0]})")
        return lines

    def _odd(self, command: str, lines: list[str], expected: str) -> NotConnected:
        return OddAnswer(
            f"filter_wheel: answered {' / '.join(lines)!r} to {command}, expected {expected}; is "
            "another program using it?"
        )


def _lines(answer: str) -> list[str]:
    """Lines of an answer, and without the space that ends the prompt before it."""
    return [line.strip() for line in answer.splitlines() if line.strip()]


def open_fw102c(settings: dict[str, Any], context: RigContext) -> Fw102c:
    """The driver `fw102c`."""
    return Fw102c(check_settings(WheelSettings, settings, context.folder), context)
