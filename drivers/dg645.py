"""Stanford Research Systems DG645 digital delay generator, over SCPI on TCP.

Commands: DG645 user manual, remote programming; the maker's driver (srsinst.dg645) agrees.
Each output pair sends a pulse from its first edge to its second: AB from A to B.

A reference image must not inject: both edges of the injector's pair are then at the same time, and
its level is the lowest of the instrument (0.5 V). Check that output with an oscilloscope before the
first acquisition.
"""

from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import model_validator

from cldit.rig.checks import check_burst, plain_burst
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, DeviceTimeout, FireUncertain, RigError
from cldit.rig.protocols import Burst, DeviceInfo
from cldit.scene.checks import Within

from .line_address import LineAddress
from .scpi import ScpiInstrument

Pair = Literal["AB", "CD", "EF", "GH"]

_EDGES = {"AB": (2, 3), "CD": (4, 5), "EF": (6, 7), "GH": (8, 9)}  # channels of DLAY
_OUTPUTS = {"AB": 1, "CD": 2, "EF": 3, "GH": 4}  # of LAMP, LOFF, LPOL
_SINGLE_SHOT = 5  # of TSRC
_LOWEST_V = 0.5  # level of an output, 0.5 to 5 V
_STEP_S = 1e-11  # largest difference between a delay written and read back; resolution 5 ps
_TRIGGERED, _RATE_ERROR = 1 << 0, 1 << 1  # of INSR?
_BUSY, _IN_BURST = 1 << 1, 1 << 2  # of *STB?


ABOUT = DriverAbout(
    "trigger",
    "SRS DG645 delay generator, SCPI over TCP",
    "untested on hardware; tested with a simulator that the maker's own driver agrees with",
    needs=("pyvisa", "pyvisa_py"),
)


class Dg645Settings(LineAddress):
    host: str
    serial: None = None
    port: Annotated[int, Within(1, 65535)] = 5025
    camera: Pair = "AB"  # the output at the camera's trigger input
    injector: Pair = "CD"  # the output at the injector's driver
    camera_V: Annotated[float, Within(0.5, 5.0)] = 5.0
    injector_V: Annotated[float, Within(1.0, 5.0)] = 5.0
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0

    @model_validator(mode="after")
    def _apart(self) -> "Dg645Settings":
        if self.camera == self.injector:
            raise ValueError(f"camera, injector: both are {self.camera}; allowed: two outputs")
        return self


class Dg645(ScpiInstrument):
    """A `cldit.rig.protocols.TriggerGenerator`."""

    def __init__(self, settings: Dg645Settings, context: RigContext) -> None:
        maker = "Stanford Research Systems"
        super().__init__(
            DeviceInfo("trigger", maker, "DG645", tested_on_hardware=False),
            settings,
            by_hand=f"unplug the cable of the output {settings.injector}, or switch the DG645 off",
        )
        self._settings = settings
        self._clock = context.clock
        self._burst: Burst | None = None
        self._inhibited = True
        self._told = "only identified"

    def _identify(self) -> None:
        info = self._line.identity("DG645")
        serial, firmware = info.serial.removeprefix("s/n"), info.firmware.removeprefix("ver")
        self._info = replace(info, serial=serial, firmware=firmware)

    def _prepare(self) -> None:
        self._line.integer("*CLS;LERR?")
        self._still()

    def _drop(self) -> None:
        super()._drop()
        self._inhibited = True

    def _last_known(self) -> str:
        return self._told

    def read_configuration(self) -> dict[str, Any]:
        edges = [edge for pair in self._pairs for edge in _EDGES[pair]]
        return {
            **self._settings.model_dump(mode="json"),
            "burst": plain_burst(self._burst),
            "inhibited": self._inhibited,
            "delays": {f"DLAY {edge}": self._line.numbers(f"DLAY? {edge}", 2) for edge in edges},
            "levels_V": [self._line.number(f"LAMP? {_OUTPUTS[pair]}") for pair in self._pairs],
            "trigger_source": self._line.integer("TSRC?"),
            "inhibit_input": self._line.integer("INHB?"),
        }

    @property
    def _pairs(self) -> tuple[Pair, Pair]:
        return self._settings.camera, self._settings.injector

    def configure(self, burst: Burst) -> Burst:
        self.inhibit()
        check_burst(burst)
        injector_level = f"{self._settings.injector_V:g} V" if burst.inject else "at rest"
        self._told = (
            f"a burst of {burst.n}, injector's output {self._settings.injector} {injector_level}; "
            "a trigger sends it"
        )
        delays = (burst.camera_delay_s, burst.injector_delay_s)
        camera, injector = self._pairs
        got_delays = [
            self._edge(_EDGES[pair][0], 0, delay)
            for pair, delay in zip(self._pairs, delays, strict=True)
        ]
        camera_width = self._edge(_EDGES[camera][1], _EDGES[camera][0], burst.widths_s[0])
        injector_width = float(f"{burst.widths_s[1]:.12f}")
        level_V = _LOWEST_V
        if burst.inject:
            begin, end = _EDGES[injector]
            injector_width = self._edge(end, begin, burst.widths_s[1])
            level_V = self._settings.injector_V
        self._set("LAMP", _OUTPUTS[camera], self._settings.camera_V)
        self._set("LAMP", _OUTPUTS[injector], level_V)
        period_s = float(f"{burst.period_s:.8f}")
        if burst.n > 1:
            self._set("BURC", None, burst.n)
            period_s = self._set("BURP", None, period_s)
            self._set("BURD", None, 0.0)
            self._set("BURM", None, 1)
        self._no_error("the burst")
        self._burst = replace(
            burst,
            period_s=period_s,
            camera_delay_s=got_delays[0],
            injector_delay_s=got_delays[1],
            widths_s=(camera_width, injector_width),
        )
        self._inhibited = False
        return self._burst

    def fire(self) -> None:
        # Reading clears it; detects a dead link before firing, which only the session fires that
        # configured.
        self._line.integer("INSR?", once=True)
        if self._burst is None or self._inhibited:
            raise ConfigRejected("trigger: is inhibited; configure a burst first")
        try:
            status = self._line.integer("*TRG;INSR?", once=True)
        except RigError as error:
            raise FireUncertain(
                f"trigger: the link failed while the trigger was sent ({error})"
            ) from error
        if status & _RATE_ERROR:
            raise FireUncertain(
                "trigger: rate error, the trigger was sent while the last one was still running"
            )
        if not status & _TRIGGERED:
            raise FireUncertain(
                f"trigger: the instrument does not confirm the trigger (INSR {status}); is "
                "its inhibit input active?"
            )

    def wait_done(self, timeout_s: float) -> None:
        end_s = self._clock.now_s() + timeout_s
        while self._line.integer("*STB?") & (_BUSY | _IN_BURST):
            if self._clock.now_s() >= end_s:
                raise DeviceTimeout(f"trigger: the burst is not over after {timeout_s:g} s")
            self._clock.sleep(1e-3)
        if self._line.integer("INSR?", once=True) & _RATE_ERROR:
            raise FireUncertain("trigger: rate error within the burst; pulses are missing")

    def inhibit(self) -> None:
        self._inhibited = True
        self._still()

    def abort(self) -> None:
        self._line.write("BURM 0")  # a changed setting ends the running cycle

    def _still(self) -> None:
        """Allows *TRG alone to trigger one cycle, without a pulse at the injector's output."""
        self._write_safe()
        self._check_safe()

    def _write_safe(self) -> None:
        self._inhibited = True
        injector = self._settings.injector
        begin, end = _EDGES[injector]
        self._line.write(
            f"*CLS;DLAY {end},{begin},0;LAMP {_OUTPUTS[injector]},{_LOWEST_V:g};BURM 0;"
            f"TSRC {_SINGLE_SHOT}"
        )

    def _check_safe(self) -> str:
        injector = self._settings.injector
        begin, end = _EDGES[injector]
        self._set("TSRC", None, _SINGLE_SHOT)
        self._set("BURM", None, 0)
        self._edge(end, begin, 0.0)
        self._set("LAMP", _OUTPUTS[injector], _LOWEST_V)
        self._no_error("being inhibited")
        self._told = f"inhibited, output {injector} still"
        return f"inhibited: no burst, output {injector} without a pulse and at {_LOWEST_V:g} V"

    def _edge(self, channel: int, reference: int, delay_s: float) -> float:
        command = f"DLAY {channel},{reference},{delay_s:.12f};DLAY? {channel}"
        against, delay = self._line.numbers(command, 2)
        if against != reference or not abs(delay - delay_s) <= _STEP_S:
            raise ConfigRejected(
                f"trigger: DLAY {channel} reads back {against:g},{delay:.12f} after "
                f"{reference},{delay_s:.12f}"
            )
        return delay

    def _set(self, command: str, channel: int | None, value: float) -> float:
        index = "" if channel is None else f"{channel}"
        comma = "," if index else ""
        got = self._line.number(f"{command} {index}{comma}{value:.12g};{command}? {index}")
        if not abs(got - value) <= 1e-6 * abs(value):
            raise ConfigRejected(f"trigger: {command} {index} reads back {got:g} after {value:g}")
        return got

    def _no_error(self, action: str) -> None:
        code = self._line.integer("LERR?", once=True)
        if code:
            self._line.write("*CLS")
            raise ConfigRejected(f"trigger: error {code} at {action}; see the DG645's manual")


def open_dg645(settings: dict[str, Any], context: RigContext) -> Dg645:
    """The driver `dg645`."""
    return Dg645(check_settings(Dg645Settings, settings), context)
