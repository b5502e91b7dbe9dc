"""A simulated black body, which can be slow, noisy, or unplugged."""

from typing import Annotated, Any

from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.scene.checks import Within
from cldit.scene.values import Temperature

from .controller import BlackBody, BlackBodyLimits
from .heater import Heater
from .simulated_scene import SimulatedDevice, SimulatedScene, bench_of

ABOUT = DriverAbout("background", "a black body", "simulated")


class BlackBodySettings(BlackBodyLimits):
    time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    start_K: Temperature = 295.0  # also the safe set point
    limits_K: tuple[Temperature, Temperature] = (253.0, 873.0)
    noise_K: Annotated[float, Within(0.0, 10.0)] = 0.02  # standard deviation of a reading
    unplug_after: Annotated[int, Within(0, 10**9)] | None = None  # readings before it is unplugged
    stable_within_K: Annotated[float, Within(0.0, 100.0)] = 0.5  # the controller's own flag

    @property
    def safe_setpoint_K(self) -> float:
        return self.start_K


class SimulatedBlackBody(SimulatedDevice, BlackBody[BlackBodySettings]):
    """Implements `cldit.rig.protocols.Background`."""

    def __init__(
        self, settings: BlackBodySettings, context: RigContext, bench: SimulatedScene
    ) -> None:
        SimulatedDevice.__init__(self, "background", "black body", settings.unplug_after)
        BlackBody.__init__(self, settings, context.clock)
        self._bench = bench
        self._heater = Heater(context.clock, settings.start_K, settings.time_constant_s)

    def _open(self, timeout_s: float) -> None:
        self._check()
        self._bench.attach_blackbody(self._heater.temperature_K)

    def _write_safe(self) -> None:
        self._aim(self.safe_setpoint_K)

    def _check_safe(self) -> str:
        return self._described(self._heater.setpoint_K)

    def _last_known(self) -> str:
        return str(self._setpoint)

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
        self._used += 1
        noise = self._bench.random(now_s, 2, self._used).normal(0.0, self._settings.noise_K)
        return self._heater.temperature_K(now_s) + float(noise)

    def is_stable(self) -> bool | None:
        self._check()
        off = abs(self._heater.now_K() - self._heater.setpoint_K)
        return off <= self._settings.stable_within_K


def open_blackbody(settings: dict[str, Any], context: RigContext) -> SimulatedBlackBody:
    """The driver `simulated_blackbody`."""
    checked = check_settings(BlackBodySettings, settings)
    return SimulatedBlackBody(checked, context, bench_of(context))
