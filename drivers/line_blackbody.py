"""Black bodies with a line protocol over TCP or a serial line, whose commands the rig file gives.

Nothing here is specific to an instrument: its manual gives the templates for the rig file, and
`cldit check-driver line_blackbody rig.yaml` tries them on an emulator of the same templates.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, Literal

from cldit.rig.checks import check_answer
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import NotConnected, OddAnswer
from cldit.rig.link import Told
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within
from cldit.scene.values import ZERO_CELSIUS_K

from .controller import BlackBody, ControllerSettings
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
    unit: Literal["celsius", "kelvin"] = "celsius"  # unit of all numbers
    temperature: Ask
    setpoint: Ask  # reads it
    set: Tell  # writes it
    identity: Command | None = None  # with a unique answer, as the first query on a line
    stable: Ask | None = None  # 1 or 0
    heater_on: Command | None = None  # if it has a switch (in YAML `on` means true)
    heater_off: Command | None = None
    port: Annotated[int, Within(1, 65535)] = 5025
    baudrate: Annotated[int, Within(300, 1_000_000)] = 9600
    parity: Literal["none", "even", "odd"] = "none"
    data_bits: Annotated[int, Within(7, 8)] = 8
    write_end: str = "\r\n"  # of each line; "\r\n" in double quotes
    read_end: str = "\n"
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0


class LineBlackBody(ScpiInstrument, BlackBody[LineSettings]):
    """Implements `cldit.rig.protocols.Background`."""

    def __init__(self, settings: LineSettings, context: RigContext) -> None:
        options: dict[str, Any] = {
            "write_termination": settings.write_end,
            "read_termination": settings.read_end,
        }
        if settings.serial is not None:
            options |= {"baud_rate": settings.baudrate, "data_bits": settings.data_bits}
        if settings.identity is None:
            # Where no answer looks like no other, one that is late must not be waited for in vain.
            options["quiet_s"] = settings.answer_s
        ScpiInstrument.__init__(
            self,
            DeviceInfo("background", settings.maker, settings.model, tested_on_hardware=False),
            f"{settings.model} at {settings.where}",
            settings.resource,
            by_hand="lower its set point at its front panel, or switch its mains off",
            address=settings.address,
            **options,
        )
        BlackBody.__init__(self, settings, context.clock)
        self._offset_K = ZERO_CELSIUS_K if settings.unit == "celsius" else 0.0
        self._heater = Told("heater")
        self._set_first = False

    def _open(self, timeout_s: float) -> None:
        from pyvisa.constants import Parity

        if self._settings.serial is not None:
            self._line.add_options(parity=Parity[self._settings.parity])
        self._line.open(min(timeout_s, self._settings.answer_s))
        identity = self._settings.identity
        if identity is not None and identity.answer is not None:
            fits = pattern(identity.answer).fullmatch
            said = self._line.first(
                identity.text(), lambda text: text if fits(text) else None, identity.answer
            )
            self._info = replace(self._info, firmware=said)

    def _prepare(self) -> None:
        self.read_temperature()

    def _last_known(self) -> str:
        heater = f", {self._heater}" if self._settings.heater_on else ""
        return f"{self._setpoint}{heater}"

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "setpoint_K": self._kelvin(self._settings.setpoint),
        }

    def _still(self) -> str:
        """Switches the heater off, if possible, and sets the safe set point; what it says to either
        is checked after both. Each attempt begins with the other one, so that a command without the
        expected answer does not keep the other from being sent."""
        off, safe_K = self._settings.heater_off, self._settings.safe_setpoint_K
        self._setpoint.written(f"{safe_K:.1f} K")
        commands: list[tuple[Command, float]] = [(self._settings.set, safe_K - self._offset_K)]
        if off is not None:
            self._heater.written("off")
            commands.insert(int(self._set_first), (off, 0.0))
        self._set_first = not self._set_first
        for check in [self._told(command, value) for command, value in commands]:
            check()
        self._set_first, heater = False, ""
        if off is not None:
            answers = off.answer is not None
            heater = "heater off, " if answers else "switched the heater off (not confirmed), "
            if answers:
                self._heater.confirmed("off")
        got_K = self._confirmed(safe_K, self._kelvin(self._settings.setpoint))
        return f"{heater}set point {got_K:.1f} K"

    def _aim(self, temperature_K: float) -> float:
        self._setpoint.written(f"{temperature_K:.1f} K")
        self._told(self._settings.set, temperature_K - self._offset_K)()
        got_K = self._confirmed(temperature_K, self._kelvin(self._settings.setpoint))
        if self._settings.heater_on is not None:
            self._heater.written("on")
            self._told(self._settings.heater_on)()
        return got_K

    def read_temperature(self) -> float:
        return self._kelvin(self._settings.temperature)

    def is_stable(self) -> bool | None:
        if self._settings.stable is None:
            return None
        ask = self._settings.stable
        value = self._line.ask(ask.text(), lambda answer: self._in(ask, answer))
        if value not in (0.0, 1.0):
            raise NotConnected(f"background: answered {value:g} to stable, expected 0 or 1")
        return value == 1.0

    # Templates on the line

    def _told(self, command: Command, value: float = 0.0) -> Callable[[], None]:
        """Sends a command, and returns the check of its answer."""
        text, expected = command.text(value), command.answer
        if expected is None:
            self._line.write(text)
            return lambda: None
        answer = self._line.query(text)

        def check() -> None:
            with self._asking():
                if not pattern(expected).fullmatch(answer):
                    raise OddAnswer(
                        f"background: answered {answer!r} to {text}, expected {expected}"
                    )

        return check

    def _kelvin(self, ask: Ask) -> float:
        def parse(answer: str) -> float:
            return self._plausible(ask.send, self._in(ask, answer) + self._offset_K)

        return self._line.ask(ask.text(), parse)

    def _in(self, ask: Ask, answer: str) -> float:
        found = pattern(ask.answer).fullmatch(answer)
        if found is None:
            raise OddAnswer(
                f"background: answered {answer!r} to {ask.send}, expected {ask.answer}; is another "
                "program using it?"
            )
        return check_answer("background", ask.send, found[1])


def open_line_blackbody(settings: dict[str, Any], context: RigContext) -> LineBlackBody:
    """The driver `line_blackbody`."""
    return LineBlackBody(check_settings(LineSettings, settings), context)
