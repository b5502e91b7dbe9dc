"""Fluke 4180/4181 infrared calibrators: SCPI on a serial line (9600 8N1) or through a TCP server.

Commands: Fluke 418x technical guide. The instrument is set to degrees Celsius.
"""

from typing import Annotated, Any

from cldit.rig.checks import check_answer
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected
from cldit.rig.link import Told
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within
from cldit.scene.values import ZERO_CELSIUS_K, Temperature

from .controller import BlackBody, ControllerSettings
from .scpi import ScpiInstrument

ABOUT = DriverAbout(
    "background",
    "Fluke 4180/4181, SCPI over serial or TCP",
    "untested on hardware; tested with a simulator, without an independent peer",
    needs=("pyvisa", "pyvisa_py", "serial"),
)


class FlukeSettings(ControllerSettings):
    limits_K: tuple[Temperature, Temperature] = (308.15, 773.15)  # of a 4181
    baudrate: Annotated[int, Within(1200, 115_200)] = 9600
    port: Annotated[int, Within(1, 65535)] = 4001
    stable_within_K: Annotated[float, Within(0.01, 10.0)] = 0.2  # for the instrument's own flag
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0


class Fluke418x(ScpiInstrument, BlackBody[FlukeSettings]):
    """Implements `cldit.rig.protocols.Background`."""

    def __init__(self, settings: FlukeSettings, context: RigContext) -> None:
        ScpiInstrument.__init__(
            self,
            DeviceInfo("background", "Fluke", "418x", tested_on_hardware=False),
            f"Fluke 418x at {settings.where}",
            settings.resource,
            by_hand="switch its heater off at its keypad, or its mains switch",
            address=settings.address,
            **({} if settings.serial is None else {"baud_rate": settings.baudrate}),
        )
        BlackBody.__init__(self, settings, context.clock)
        self._heater = Told("heater")

    def _open(self, timeout_s: float) -> None:
        self._line.open(min(timeout_s, self._settings.answer_s))
        self._info = self._line.identity("418")
        self._line.write("UNIT:TEMP C")
        self._line.write(f"SOUR:STAB:LIM {self._settings.stable_within_K:g}")

    def _last_known(self) -> str:
        return f"{self._setpoint}, {self._heater}"

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "setpoint_K": self._kelvin("SOUR:SPO?"),
            "heating": self._line.flag("OUTP:STAT?"),
            "stability_limit_K": self._line.number("SOUR:STAB:LIM?"),
        }

    def _still(self) -> str:
        """Switches the heater off first, which suffices by itself; then sets the safe set point.
        Both are read back after both are written."""
        safe_K = self._settings.safe_setpoint_K
        self._heater.written("off")
        self._line.write("OUTP:STAT 0")
        self._setpoint.written(f"{safe_K:.1f} K")
        self._line.write(f"SOUR:SPO {safe_K - ZERO_CELSIUS_K:.2f}")
        self._check_output(False)
        got_K = self._confirmed(safe_K, self._kelvin("SOUR:SPO?"))
        return f"heater off, set point {got_K:.1f} K"

    def _aim(self, temperature_K: float) -> float:
        self._setpoint.written(f"{temperature_K:.1f} K")
        self._line.write(f"SOUR:SPO {temperature_K - ZERO_CELSIUS_K:.2f}")
        got_K = self._confirmed(temperature_K, self._kelvin("SOUR:SPO?"))
        self._heater.written("on")
        self._line.write("OUTP:STAT 1")
        self._check_output(True)
        return got_K

    def read_temperature(self) -> float:
        return self._kelvin("SOUR:SENS:DATA?")

    def is_stable(self) -> bool | None:
        return self._line.flag("SOUR:STAB:TEST?")

    def _kelvin(self, command: str) -> float:
        def kelvin(answer: str) -> float:
            return self._plausible(
                command, check_answer("background", command, answer) + ZERO_CELSIUS_K
            )

        return self._line.ask(command, kelvin)

    def _check_output(self, on: bool) -> None:
        state = "on" if on else "off"
        if self._line.flag("OUTP:STAT?") is not on:
            raise ConfigRejected(f"background: the heater does not switch {state}")
        self._heater.confirmed(state)


def open_fluke418x(settings: dict[str, Any], context: RigContext) -> Fluke418x:
    """The driver `fluke418x`."""
    return Fluke418x(check_settings(FlukeSettings, settings), context)
