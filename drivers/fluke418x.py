"""Fluke 4180/4181 infrared calibrators: SCPI on a serial line (9600 8N1) or through a TCP server.

Commands: Fluke 418x technical guide. The instrument is set to degrees Celsius.
"""

from typing import Annotated, Any

from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.scene.checks import Within
from cldit.scene.values import Temperature

from .controller import ControllerSettings
from .line_blackbody import LineBlackBody, LineSettings

ABOUT = DriverAbout(
    "background",
    "Fluke 4180/4181, SCPI over serial or TCP",
    "untested on hardware; tested with a simulator, without an independent peer",
    needs=("pyvisa", "pyvisa_py", "serial"),
)

_COMMANDS: dict[str, Any] = {
    "maker": "Fluke",
    "model": "418x",
    "unit": "celsius",
    "unit_check": {"send": "UNIT:TEMP?", "answer": "C"},
    "identity": {"send": "*IDN?", "answer": "{any},418{any},{any},{any}"},
    "temperature": {"send": "SOUR:SENS:DATA?", "answer": "{value}"},
    "setpoint": {"send": "SOUR:SPO?", "answer": "{value}"},
    "set": {"send": "SOUR:SPO {value:.2f}"},
    "stable": {"send": "SOUR:STAB:TEST?", "answer": "{value}"},
    "heater_on": {"send": "OUTP:STAT 1"},
    "heater_off": {"send": "OUTP:STAT 0"},
    "heater": {"send": "OUTP:STAT?", "answer": "{value}"},
    "write_end": "\n",
}


class FlukeSettings(ControllerSettings):
    limits_K: tuple[Temperature, Temperature] = (308.15, 773.15)  # of a 4181
    baudrate: Annotated[int, Within(1200, 115_200)] = 9600
    port: Annotated[int, Within(1, 65535)] = 4001
    stable_within_K: Annotated[float, Within(0.01, 10.0)] = 0.2  # for the instrument's own flag
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0


def open_fluke418x(settings: dict[str, Any], context: RigContext) -> LineBlackBody:
    """The driver `fluke418x`."""
    line = check_settings(FlukeSettings, settings).model_dump()
    begin = ("UNIT:TEMP C", f"SOUR:STAB:LIM {line.pop('stable_within_K'):g}")
    commands = {**_COMMANDS, "begin": [{"send": command} for command in begin]}
    return LineBlackBody(check_settings(LineSettings, {**commands, **line}), context)
