"""A simulated trigger generator, with the injector at its other output."""

import json
from pathlib import Path
from typing import Annotated, Any

from cldit.io.files import append_text
from cldit.rig.checks import check_burst, plain_burst
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, DeviceTimeout, FireUncertain, NotConnected
from cldit.rig.protocols import Burst
from cldit.scene.checks import Section, Within

from .simulated_scene import Pulse, SimulatedDevice, SimulatedScene, bench_of

ABOUT = DriverAbout("trigger", "a delay generator with an injector", "simulated")


class InjectorSettings(Section):
    misfire: Annotated[float, Within(0.0, 1.0)] = 0.0  # fraction of the injections without fuel
    rate_error: Annotated[float, Within(0.0, 1.0)] = 0.0  # fraction of the triggers, rejected
    unplug_after: Annotated[int, Within(0, 10**9)] | None = None  # triggers before it is unplugged
    pulse_log: Path | None = None  # one JSON line for each burst, as the device counts


class SimulatedInjector(SimulatedDevice):
    """Implements `cldit.rig.protocols.TriggerGenerator`."""

    def __init__(
        self, settings: InjectorSettings, context: RigContext, bench: SimulatedScene
    ) -> None:
        super().__init__("trigger", "injector", settings.unplug_after)
        self._log = None if settings.pulse_log is None else context.folder / settings.pulse_log
        self._faults = settings
        self._clock = context.clock
        self._bench = bench
        self._burst: Burst | None = None
        self._inhibited = True
        self._starts_s: list[float] = []
        self._done_s = context.clock.now_s()
        self._pulses = 0
        self._injections = 0

    def _open(self, timeout_s: float) -> None:
        if self._log is not None and not self._log.parent.is_dir():
            raise NotConnected(f"trigger: {self._log.parent}: no such folder for pulse_log")
        self._check()

    def _write_safe(self) -> None:
        self.abort()
        self.inhibit()

    def _check_safe(self) -> str:
        return "inhibited"

    def _last_known(self) -> str:
        inject = self._burst is not None and self._burst.inject and not self._inhibited
        return "a trigger injects" if inject else "a trigger does not inject"

    def read_configuration(self) -> dict[str, Any]:
        self._check()
        return {
            "burst": plain_burst(self._burst),
            "inhibited": self._inhibited,
            "spray_times_s": list(self._bench.spray_times_s),
        }

    def configure(self, burst: Burst) -> Burst:
        self.inhibit()  # nothing can fire after a rejected burst
        check_burst(burst)
        self._burst = burst
        self._inhibited = False
        return self._burst

    def fire(self) -> None:
        self._check()
        if self._burst is None or self._inhibited:
            raise ConfigRejected("trigger: is inhibited; configure a burst first")
        burst, start_s = self._burst, self._clock.now_s()
        if start_s < self._done_s:
            raise ConfigRejected("trigger: is still firing; wait_done() first")
        in_air = burst.inject and burst.camera_delay_s >= burst.injector_delay_s
        chance = self._bench.random(start_s, 5).random(2)
        if chance[0] < self._faults.rate_error:
            raise FireUncertain("trigger: rate error (a fault of the simulated injector)")
        in_air = in_air and not chance[1] < self._faults.misfire
        self._count(burst.n)
        self._used += 1
        self._starts_s = [start_s + index * burst.period_s for index in range(burst.n)]
        for pulse_s in self._starts_s:
            self._pulses += 1
            after_s = burst.camera_delay_s - burst.injector_delay_s
            self._bench.pulse(
                Pulse(
                    time_s=pulse_s + burst.camera_delay_s,
                    injected=in_air,
                    number=self._pulses,
                    after_injection_s=after_s,
                    injection=self._injections,
                )
            )
            self._injections += in_air
        ends = (
            burst.camera_delay_s + burst.widths_s[0],
            burst.injector_delay_s + burst.widths_s[1],
        )
        self._done_s = self._starts_s[-1] + max(ends)

    def wait_done(self, timeout_s: float) -> None:
        self._check()
        left_s = self._done_s - self._clock.now_s()
        if left_s > timeout_s:
            self._clock.sleep(timeout_s)
            raise DeviceTimeout(
                f"trigger: the burst needs {left_s - timeout_s:.3g} s longer than the "
                f"{timeout_s:g} s allowed"
            )
        if left_s > 0.0:
            self._clock.sleep(left_s)

    def inhibit(self) -> None:
        self._check()
        self._inhibited = True

    def abort(self) -> None:
        self._check()
        now_s = self._clock.now_s()
        unsent = [pulse_s for pulse_s in self._starts_s if pulse_s > now_s]
        if unsent:
            self._bench.cancel(after_s=now_s)
            self._count(-len(unsent))
        self._starts_s = []
        self._done_s = min(self._done_s, now_s)

    def _count(self, pulses: int) -> None:
        if self._log is None or self._burst is None:
            return
        entry = {"time": self._clock.wall_time(), "inject": self._burst.inject, "pulses": pulses}
        line = json.dumps(entry) + "\n"
        append_text(self._log, line)


def open_injector(settings: dict[str, Any], context: RigContext) -> SimulatedInjector:
    """The driver `simulated_injector`."""
    return SimulatedInjector(check_settings(InjectorSettings, settings), context, bench_of(context))
