"""Black bodies with a line protocol over TCP or a serial line, whose commands the rig file gives.

Nothing here is specific to an instrument: its manual gives the templates for the rig file, and
`cldit check-driver line_blackbody rig.yaml` tries them on an emulator of the same templates.
"""

from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

from cldit.rig.checks import check_answer
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, OddAnswer
from cldit.rig.link import Told, send_all
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within

from .controller import BlackBody, ControllerSettings, Unit, from_kelvin, to_kelvin
from .line_templates import Ask, Command, Tell, pattern
from .scpi import ScpiInstrument

ABOUT = DriverAbout(
    "background",
    "black bodies with a line protocol, TCP or serial, by templates in the rig file",
    "untested on hardware; tested with a simulator, and with pyvisa-sim",
    needs=("pyvisa", "pyvisa_py", "serial"),
)


class LineSettings(ControllerSettings):
    maker: str = "unknown maker"
    model: str = "black body"
    unit: Unit  # unit of all numbers
    unit_check: Command | None = None  # a query, and its answer as long as that is the unit
    temperature: Ask
    setpoint: Ask  # reads it
    set: Tell  # writes it
    identity: Command | None = None  # with a unique answer, as the first query on a line
    stable: Ask | None = None  # 1 or 0
    heater_on: Command | None = None  # if it has a switch (in YAML `on` means true)
    heater_off: Command | None = None
    heater: Ask | None = None  # reads the switch, 1 or 0
    begin: tuple[Command, ...] = ()  # sent first, and when the rig is made safe
    port: Annotated[int, Within(1, 65535)] = 5025
    baudrate: Annotated[int, Within(300, 1_000_000)] = 9600
    parity: Literal["none", "even", "odd"] = "none"
    data_bits: Annotated[int, Within(7, 8)] = 8
    write_end: str = "\r\n"  # of each line; "\r\n" in double quotes
    read_end: str = "\n"
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0


class LineBlackBody(BlackBody[LineSettings], ScpiInstrument):
    """Implements `cldit.rig.protocols.Background`."""

    def __init__(self, settings: LineSettings, context: RigContext) -> None:
        options: dict[str, Any] = {
            "write_termination": settings.write_end,
            "read_termination": settings.read_end,
        }
        if settings.serial is not None:
            options["data_bits"] = settings.data_bits
        if settings.identity is None:
            # Where no answer looks like no other, one that is late must not be waited for in vain.
            options["quiet_s"] = settings.answer_s
        ScpiInstrument.__init__(
            self,
            DeviceInfo("background", settings.maker, settings.model, tested_on_hardware=False),
            settings,
            by_hand="lower its set point at its front panel, or switch its mains off",
            baudrate=settings.baudrate,
            **options,
        )
        BlackBody.__init__(self, settings, context.clock)
        self._heater = Told("heater")
        self._unit = settings.unit

    def _open(self, timeout_s: float) -> None:
        from pyvisa.constants import Parity

        if self._settings.serial is not None:
            self._line.add_options(parity=Parity[self._settings.parity])
        ScpiInstrument._open(self, timeout_s)

    def _identify(self) -> None:
        identity = self._settings.identity
        if identity is not None and identity.answer is not None:
            fits = pattern(identity.answer).fullmatch
            reply = self._line.first(
                identity.text(), lambda answer: answer if fits(answer) else None, identity.answer
            )
            self._info = replace(self._info, firmware=reply)
            parts = [part.strip() for part in reply.split(",")]
            if len(parts) == 4:  # as *IDN? is answered
                maker, model, serial, firmware = parts
                self._info = replace(
                    self._info, maker=maker, model=model, serial=serial, firmware=firmware
                )
        for command in (*self._settings.begin, self._settings.unit_check):
            if command is not None:
                self._tell(command)

    def _last_known(self) -> str:
        heater = f", {self._heater}" if self._settings.heater_on else ""
        return f"{self._setpoint}{heater}"

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "setpoint_K": self._kelvin(self._settings.setpoint),
            **(
                {} if (heater := self._settings.heater) is None else {"heating": self._flag(heater)}
            ),
        }

    def _write_safe(self) -> None:
        """Switches the heater off, if possible, and sets the safe set point."""
        off, safe_K = self._settings.heater_off, self.safe_setpoint_K
        self._setpoint.written(f"{safe_K:.1f} K")
        if off is not None:
            self._heater.written("off")
        switches = () if off is None else (off,)
        commands = [partial(self._tell, command) for command in (*switches, *self._settings.begin)]
        send_all(*commands, partial(self._set, safe_K))

    def _check_safe(self) -> str:
        heater = self._check_heater("off", self._settings.heater_off)
        got_K = self._confirmed(self.safe_setpoint_K, self._kelvin(self._settings.setpoint))
        return heater + self._described(got_K)

    def _check_heater(self, state: str, switch: Command | None) -> str:
        """Describes the heater after its switch, which is read back if possible."""
        if switch is None:
            return ""
        ask = self._settings.heater
        if ask is not None and self._flag(ask) is not (state == "on"):
            raise ConfigRejected(f"background: the heater does not switch {state}")
        if ask is None and switch.answer is None:
            return f"switched the heater {state} (not confirmed), "
        self._heater.confirmed(state)
        return f"heater {state}, "

    def _aim(self, temperature_K: float) -> float:
        self._setpoint.written(f"{temperature_K:.1f} K")
        self._set(temperature_K)
        got_K = self._confirmed(temperature_K, self._kelvin(self._settings.setpoint))
        if self._settings.heater_on is not None:
            self._heater.written("on")
            self._tell(self._settings.heater_on)
        self._check_heater("on", self._settings.heater_on)
        return got_K

    def read_temperature(self) -> float:
        return self._kelvin(self._settings.temperature)

    def is_stable(self) -> bool | None:
        return None if self._settings.stable is None else self._flag(self._settings.stable)

    # Templates on the line

    def _set(self, temperature_K: float) -> None:
        self._tell(self._settings.set, from_kelvin(temperature_K, self._settings.unit))

    def _tell(self, command: Command, value: float = 0.0) -> None:
        sent, expected = command.text(value), command.answer
        if expected is None:
            self._line.write(sent)
            return

        def check(answer: str) -> None:
            if not pattern(expected).fullmatch(answer):
                raise OddAnswer(f"background: answered {answer!r} to {sent}, expected {expected}")

        self._line.ask(sent, check)

    def _flag(self, ask: Ask) -> bool:
        def parse(answer: str) -> bool:
            if (value := self._in(ask, answer)) not in (0.0, 1.0):
                raise OddAnswer(f"background: answered {answer!r} to {ask.send}, expected 0 or 1")
            return value == 1.0

        return self._line.ask(ask.text(), parse)

    def _kelvin(self, ask: Ask) -> float:
        def parse(answer: str) -> float:
            kelvin = to_kelvin(self._in(ask, answer), self._settings.unit)
            return self._plausible(ask.send, kelvin)

        return self._line.ask(ask.text(), parse)

    def _in(self, ask: Ask, answer: str) -> float:
        match = pattern(ask.answer).fullmatch(answer)
        if match is None:
            raise OddAnswer(
                f"background: answered {answer!r} to {ask.send}, expected {ask.answer}; is another "
                "program using it?"
            )
        return check_answer("background", ask.send, match[1].replace(" ", ""))


def open_line_blackbody(settings: dict[str, Any], context: RigContext) -> LineBlackBody:
    """The driver `line_blackbody`."""
    return LineBlackBody(check_settings(LineSettings, settings), context)
