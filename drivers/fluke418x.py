"""Fluke 4180/4181 infrared calibrators: SCPI on a serial line (9600 8N1) or through a TCP server.

Commands: Fluke 418x technical guide. The instrument is told to speak degrees Celsius.
"""

from __future__ import annotations

from typing import Annotated, Any

from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, NotConnected, RigError
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within
from cldit.scene.values import Temperature

from .controller import KELVIN, BlackBody, ControllerSettings, check_readback
from .scpi import ScpiLink

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


class Fluke418x(BlackBody[FlukeSettings]):
    """A `cldit.rig.protocols.Background`."""

    def __init__(self, settings: FlukeSettings, context: RigContext) -> None:
        super().__init__(settings, context.clock)
        if settings.host is not None:
            self._link = ScpiLink("background", f"TCPIP::{settings.host}::{settings.port}::SOCKET")
        else:
            self._link = ScpiLink(
                "background", f"ASRL{settings.serial}::INSTR", baud_rate=settings.baudrate
            )
        self._info = DeviceInfo("background", "Fluke", "418x", tested_on_hardware=False)

    def connect(self, timeout_s: float = 10.0) -> None:
        if self._link.is_open:
            return
        self._link.open(min(timeout_s, self._settings.answer_s))
        try:
            self._info = self._link.identity("418")
            self._link.write("UNIT:TEMP C")
            self._link.write(f"SOUR:STAB:LIM {self._settings.stable_within_K:g}")
        except RigError as error:
            self._link.close()
            raise NotConnected(str(error)) from error

    def close(self) -> None:
        self._link.close()

    def identify(self) -> DeviceInfo:
        return self._info

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "setpoint_K": self._link.number("SOUR:SPO?") + KELVIN,
            "heating": self._link.number("OUTP:STAT?") == 1.0,
            "stability_limit_K": self._link.number("SOUR:STAB:LIM?"),
        }

    def make_safe(self) -> None:
        """The lowest harmless set point, and the heater off."""
        if self._link.is_open:
            self._write(self._settings.safe_setpoint_K)
            self._output(False)

    def _aim(self, temperature_K: float) -> float:
        got_K = self._write(temperature_K)
        self._output(True)
        return got_K

    def read_temperature(self) -> float:
        return self._link.number("SOUR:SENS:DATA?") + KELVIN

    def is_stable(self) -> bool | None:
        return self._link.number("SOUR:STAB:TEST?") == 1.0

    def _write(self, temperature_K: float) -> float:
        self._link.write(f"SOUR:SPO {temperature_K - KELVIN:.2f}")
        return check_readback(temperature_K, self._link.number("SOUR:SPO?") + KELVIN)

    def _output(self, on: bool) -> None:
        self._link.write(f"OUTP:STAT {int(on)}")
        if (self._link.number("OUTP:STAT?") == 1.0) is not on:
            raise ConfigRejected(f"background: the heater does not switch {'on' if on else 'off'}")


def open_fluke418x(settings: dict[str, Any], context: RigContext) -> Fluke418x:
    """The driver `fluke418x`."""
    return Fluke418x(check_settings(FlukeSettings, settings), context)
