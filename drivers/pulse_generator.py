"""Berkeley Nucleonics 505, 575, 577 and Quantum Composers 9200, 9510, 9520 pulse generators.

Text commands over TCP or a serial line, from the makers' manuals of the 575 and the 9520 series.
Every command has an answer: `ok`, a value, or `?n` for a rejection. The instrument sends a burst
after its outputs are switched on: one pulse (SINGle), or n pulses (BURSt), with its external
trigger disabled. It does not report the end of a burst, so the driver waits for its duration.

For a reference image the injector's channel is switched off. Check that output with an oscilloscope
before the first acquisition: none of this was tried on an instrument.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import model_validator

from cldit.rig.checks import ROUNDING, check_burst, plain_burst
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, DeviceTimeout, FireUncertain, RigError
from cldit.rig.link import send_all
from cldit.rig.protocols import Burst, DeviceInfo
from cldit.scene.checks import Within

from .line_address import LineAddress
from .scpi import ScpiInstrument

ABOUT = DriverAbout(
    "trigger",
    "BNC 505/575/577, Quantum Composers 9200/9510/9520 pulse generators, TCP or serial",
    "untested on hardware; tested with a simulator that QMI's driver of the 9530 agrees with",
    needs=("pyvisa", "pyvisa_py", "serial"),
)

Output = Literal["A", "B", "C", "D", "E", "F", "G", "H"]

_STEP_s = 1e-8  # largest difference between a time written and read back (coarsest series)
_MARGIN_s = 0.02  # from the last pulse to the assumed end of the burst


@dataclass(frozen=True)
class Series:
    """Properties of a series. model: begin of the model in *IDN?; system: keyword of the common
    settings; trigger: keyword of the external trigger's mode; baudrate: as delivered."""

    model: str
    system: str
    trigger: str
    baudrate: int


SERIES = {
    "bnc-505": Series("505", "PULSE0", "TRIG:MOD", 38400),
    "bnc-575": Series("575", "PULSE0", "TRIG:MOD", 115200),
    "bnc-577": Series("577", "PULSE0", "TRIG:MOD", 115200),
    "qc-9200": Series("92", "PULSE0", "TRIG:MOD", 38400),
    "qc-9510": Series("951", "SPULSE", "EXT:MOD", 38400),
    "qc-9520": Series("95", "PULSE0", "TRIG:MOD", 38400),
}


class PulseGeneratorSettings(LineAddress):
    series: Literal["bnc-505", "bnc-575", "bnc-577", "qc-9200", "qc-9510", "qc-9520"]
    port: Annotated[int, Within(1, 65535)] = 2101
    baudrate: Annotated[int, Within(300, 1_000_000)] | None = None  # None: that of the series
    camera: Output = "A"  # the output at the camera's trigger input
    injector: Output = "B"  # the output at the injector's driver
    camera_V: Annotated[float, Within(2.0, 20.0)] | None = None  # None: the TTL output
    injector_V: Annotated[float, Within(2.0, 20.0)] | None = None
    answer_s: Annotated[float, Within(0.01, 60.0)] = 2.0

    @model_validator(mode="after")
    def _apart(self) -> "PulseGeneratorSettings":
        if self.camera == self.injector:
            raise ValueError(f"camera, injector: both are {self.camera}; allowed: two outputs")
        return self


class PulseGenerator(ScpiInstrument):
    """Implements `cldit.rig.protocols.TriggerGenerator`."""

    def __init__(self, settings: PulseGeneratorSettings, context: RigContext) -> None:
        self._series = SERIES[settings.series]
        super().__init__(
            DeviceInfo("trigger", "?", settings.series, tested_on_hardware=False),
            settings,
            by_hand=f"unplug the cable of the output {settings.injector}, or switch it off",
            baudrate=settings.baudrate or self._series.baudrate,
            write_termination="\r\n",
        )
        self._settings = settings
        self._clock = context.clock
        self._camera, self._injector = (
            f":PULSE{'ABCDEFGH'.index(output) + 1}:"
            for output in (settings.camera, settings.injector)
        )
        self._system = f":{self._series.system}:"
        self._burst: Burst | None = None
        self._inhibited = True
        self._over_s = 0.0  # end of the last burst
        self._told = "only identified"

    def _identify(self) -> None:
        self._info = self._line.identity(self._series.model)

    def _prepare(self) -> None:
        self._still()

    def _drop(self) -> None:
        super()._drop()
        self._inhibited = True

    def _last_known(self) -> str:
        return self._told

    def read_configuration(self) -> dict[str, Any]:
        outputs = {"camera": self._camera, "injector": self._injector}
        return {
            **self._settings.model_dump(mode="json"),
            "burst": plain_burst(self._burst),
            "inhibited": self._inhibited,
            "running": self._flag(f"{self._system}STAT"),
            "outputs": {
                name: {
                    "on": self._flag(f"{channel}STAT"),
                    "delay_s": self._number(f"{channel}DEL"),
                    "width_s": self._number(f"{channel}WIDT"),
                }
                for name, channel in outputs.items()
            },
        }

    def configure(self, burst: Burst) -> Burst:
        self.inhibit()
        check_burst(burst)
        state = "on" if burst.inject else "off"
        self._told = (
            f"a burst of {burst.n}, injector's output {self._settings.injector} {state}; switching "
            "the outputs on sends it"
        )
        times_s: list[float] = []
        for channel, delay_s, width_s in (
            (self._camera, burst.camera_delay_s, burst.widths_s[0]),
            (self._injector, burst.injector_delay_s, burst.widths_s[1]),
        ):
            times_s.append(self._set(f"{channel}DEL", f"{delay_s:.11f}", _STEP_s))
            times_s.append(self._set(f"{channel}WIDT", f"{width_s:.11f}", _STEP_s))
        period_s = float(f"{burst.period_s:.9f}")  # the instrument's number of digits
        if burst.n > 1:
            period_s = self._set(f"{self._system}PER", f"{burst.period_s:.9f}", _STEP_s)
            self._set(f"{self._system}BCO", f"{burst.n}", 0.0)
        self._choose(f"{self._system}MOD", "SING" if burst.n == 1 else "BURS")
        self._switch(f"{self._camera}STAT", True)
        self._switch(f"{self._injector}STAT", burst.inject)
        self._burst = replace(
            burst,
            period_s=period_s,
            camera_delay_s=times_s[0],
            injector_delay_s=times_s[2],
            widths_s=(times_s[1], times_s[3]),
        )
        self._inhibited = False
        return self._burst

    def fire(self) -> None:
        burst = self._burst
        if burst is None or self._inhibited:
            self._flag(f"{self._system}STAT")  # detects a dead link first
            raise ConfigRejected("trigger: is inhibited; configure a burst first")
        if self._clock.now_s() < self._over_s:
            raise ConfigRejected("trigger: the last burst is not over; call wait_done()")
        # Off first: outputs that stayed on after a burst send nothing when switched on.
        self._switch(f"{self._system}STAT", False)
        if self._inhibited:  # the session was opened anew, and fires what it configured alone
            raise ConfigRejected("trigger: the session was closed; configure the burst again")
        last_s = max(
            burst.camera_delay_s + burst.widths_s[0], burst.injector_delay_s + burst.widths_s[1]
        )
        try:
            self._line.acknowledged(f"{self._system}STAT 1", "ok", once=True)
        except RigError as error:
            raise FireUncertain(
                f"trigger: switching the outputs on was not confirmed ({error})"
            ) from error
        self._over_s = self._clock.now_s() + (burst.n - 1) * burst.period_s + last_s + _MARGIN_s

    def wait_done(self, timeout_s: float) -> None:
        end_s = self._clock.now_s() + timeout_s
        while self._clock.now_s() < self._over_s:
            if self._clock.now_s() >= end_s:
                raise DeviceTimeout(f"trigger: the burst is not over after {timeout_s:g} s")
            self._clock.sleep(1e-3)

    def inhibit(self) -> None:
        self._inhibited = True
        self._still()

    def abort(self) -> None:
        self._switch(f"{self._system}STAT", False)
        self._over_s = 0.0

    def _still(self) -> None:
        self._write_safe()
        self._check_safe()

    def _write_safe(self) -> None:
        """Switches all outputs off, and that of the injector."""
        self._inhibited = True
        off = (f"{self._system}STAT 0", f"{self._injector}STAT 0")
        send_all(*(partial(self._line.acknowledged, command, "ok") for command in off))

    def _check_safe(self) -> str:
        """Reads back that the outputs are off; then resets what would send a pulse once they are
        on."""
        output = self._settings.injector
        self._switch(f"{self._system}STAT", False)
        self._over_s = 0.0
        self._switch(f"{self._injector}STAT", False)
        self._choose(f"{self._system}{self._series.trigger}", "DIS")
        self._choose(f"{self._system}MOD", "SING")
        for channel, volts in (
            (self._camera, self._settings.camera_V),
            (self._injector, self._settings.injector_V),
        ):
            self._choose(f"{channel}CMOD", "NORM")
            self._choose(f"{channel}POL", "NORM")
            self._choose(f"{channel}OUTP:MODE", "TTL" if volts is None else "ADJ")
            if volts is not None:
                self._set(f"{channel}OUTP:AMPL", f"{volts:.3f}", ROUNDING * volts)
        self._told = f"outputs off, injector's output {output} off"
        return f"inhibited: all outputs stopped, output {output} off"

    # One command, one answer; written values are read back

    def _flag(self, keyword: str) -> bool:
        return self._line.flag(f"{keyword}?")

    def _number(self, keyword: str) -> float:
        return self._line.number(f"{keyword}?")

    def _switch(self, keyword: str, on: bool) -> None:
        self._line.acknowledged(f"{keyword} {int(on)}", "ok")
        if self._flag(keyword) is not on:
            raise ConfigRejected(f"trigger: {keyword} does not switch {'on' if on else 'off'}")

    def _choose(self, keyword: str, entry: str) -> None:
        self._line.acknowledged(f"{keyword} {entry}", "ok")
        got = self._line.word(f"{keyword}?")
        if not got.startswith(entry):
            raise ConfigRejected(f"trigger: {keyword} reads back {got} after {entry}")

    def _set(self, keyword: str, value: str, step: float) -> float:
        self._line.acknowledged(f"{keyword} {value}", "ok")
        got = self._number(keyword)
        if not abs(got - float(value)) <= step:
            raise ConfigRejected(f"trigger: {keyword} reads back {got:g} after {value}")
        return got


def open_pulse_generator(settings: dict[str, Any], context: RigContext) -> PulseGenerator:
    """The driver `pulse_generator`."""
    return PulseGenerator(check_settings(PulseGeneratorSettings, settings), context)
