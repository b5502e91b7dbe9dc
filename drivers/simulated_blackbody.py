"""A simulated black body, which can be slow, overshoot, drift, or never settle."""

from typing import Annotated, Any

from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import NotConnected
from cldit.rig.link import Linked
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within
from cldit.scene.values import Temperature

from .controller import BlackBody, BlackBodyLimits
from .heater import Dynamics, Heater
from .simulated_scene import SimulatedScene, bench_of

ABOUT = DriverAbout("background", "a black body", "simulated")


class BlackBodySettings(Dynamics, BlackBodyLimits):
    start_K: Temperature = 295.0  # also the safe set point
    limits_K: tuple[Temperature, Temperature] = (253.0, 873.0)
    noise_K: Annotated[float, Within(0.0, 10.0)] = 0.02  # standard deviation of a reading
    unplug_after: Annotated[int, Within(0, 10**9)] | None = None  # readings before it is unplugged
    stable_within_K: Annotated[float, Within(0.0, 100.0)] = 0.5  # the controller's own flag

    @property
    def safe_setpoint_K(self) -> float:
        return self.start_K


class SimulatedBlackBody(Linked, BlackBody[BlackBodySettings]):
    """Implements `cldit.rig.protocols.Background`."""

    def __init__(
        self, settings: BlackBodySettings, context: RigContext, bench: SimulatedScene
    ) -> None:
        Linked.__init__(self, "background", "simulated black body", by_hand="remove `unplug_after`")
        BlackBody.__init__(self, settings, context.clock)
        self._bench = bench
        self._heater = Heater(settings, context.clock, settings.start_K)
        self._readings = 0

    def _open(self, timeout_s: float) -> None:
        self._check()
        self._bench.attach_blackbody(self._heater.temperature_K)

    def _drop(self) -> None:
        """Does nothing, because there is no line."""

    def _write_safe(self) -> None:
        self._aim(self.safe_setpoint_K)

    def _check_safe(self) -> str:
        return self._described(self._heater.setpoint_K)

    def _last_known(self) -> str:
        return str(self._setpoint)

    def identify(self) -> DeviceInfo:
        return DeviceInfo("background", "cldit", "simulated black body", simulated=True)

    def read_configuration(self) -> dict[str, Any]:
        self._check()
        return {**self._settings.model_dump(mode="json"), "setpoint_K": self._heater.setpoint_K}

    def _aim(self, temperature_K: float) -> float:
        self._setpoint.written(f"{temperature_K:.1f} K")
        self._check()
        self._heater.aim(temperature_K)
        return self._confirmed(temperature_K, self._heater.setpoint_K)

    def read_temperature(self) -> float:
        self._check()
        now_s = self._clock.now_s()
        self._readings += 1
        noise = self._bench.random(now_s, 2, self._readings).normal(0.0, self._settings.noise_K)
        return self._heater.temperature_K(now_s) + float(noise)

    def is_stable(self) -> bool | None:
        self._check()
        off = abs(self._heater.now_K() - self._heater.setpoint_K)
        return off <= self._settings.stable_within_K

    def _check(self) -> None:
        gone = self._settings.unplug_after
        with self._asking():
            if gone is not None and self._readings >= gone:
                raise NotConnected("background: black body was unplugged (its fault unplug_after)")


def open_blackbody(settings: dict[str, Any], context: RigContext) -> SimulatedBlackBody:
    """The driver `simulated_blackbody`."""
    checked = check_settings(BlackBodySettings, settings)
    return SimulatedBlackBody(checked, context, bench_of(context))
