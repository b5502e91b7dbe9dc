"""Emulator of a black body with the commands of a rig file, on a socket or a terminal."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from tests.emulators.blackbody import Peer
from tests.emulators.lines import AtOneLine

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.controller import from_kelvin, to_kelvin
    from drivers.line_blackbody import LineSettings
    from drivers.line_templates import Command, pattern
else:
    from cldit.drivers.controller import from_kelvin, to_kelvin
    from cldit.drivers.line_blackbody import LineSettings
    from cldit.drivers.line_templates import Command, pattern

_STABLE_K = 0.2
_FIELD = re.compile(r"\{(value(?::[^{}]*)?|any)\}")


def _example(template: str, value: float) -> str:
    """An answer that matches a template, with three decimals."""
    return _FIELD.sub(lambda field: "x" if field[1] == "any" else f"{value:.3f}", template)


class LinePeer(AtOneLine, Peer):
    """Emulated black body with the commands of `settings`, whose address is ignored."""

    def __init__(self, settings: LineSettings, **options: Any) -> None:
        super().__init__(**options)
        self._settings = settings
        self._unit = settings.unit
        self.heating = settings.heater_on is None

    @property
    def stable(self) -> bool:
        return self.heating and abs(self.heater.now_K() - self.setpoint_K) < _STABLE_K

    def _obey(self, line: bytes) -> bytes:
        text, asked = line.decode("ascii", "replace").strip(), self._settings
        values = {
            asked.temperature: from_kelvin(self.sensed_K(), self._unit),
            asked.setpoint: from_kelvin(self.setpoint_K, self._unit),
        }
        if asked.stable is not None:
            values[asked.stable] = float(self.stable)
        for command, value in values.items():
            if text == command.text():
                return self._answer(command, value)
        for switch, state in ((asked.heater_on, True), (asked.heater_off, False)):
            if switch is not None and text == switch.text():
                self.heating = state
                return self._answer(switch)
        if asked.heater is not None and text == asked.heater.text():
            return self._answer(asked.heater, float(self.heating))
        for query in (asked.identity, asked.unit_check, *asked.begin):
            if query is not None and text == query.text():
                return self._answer(query)
        found = pattern(asked.set.send).fullmatch(text)
        if found is None:
            return b"?\r\n"
        self.writes += 1
        self.heater.aim(to_kelvin(float(found[1]), self._unit))
        return self._answer(asked.set, float(found[1]))

    def _answer(self, command: Command, value: float = 0.0) -> bytes:
        if command.answer is None:
            return b""
        return (_example(command.answer, value) + "\r\n").encode()
