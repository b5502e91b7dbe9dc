"""Simulated temperature of a black body's cavity, which follows its set point, with faults."""

from math import exp, pi, sin
from typing import Annotated

from cldit.rig.clock import Clock
from cldit.scene.checks import Section, Within

_BUMP_FROM = 3.0  # time constants before an overshoot begins


class Dynamics(Section):
    """First-order approach to the set point; effects that are 0 or None are omitted."""

    time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    slew_K_per_s: Annotated[float, Within(1e-6, 1e6)] | None = None  # largest rate
    overshoot: Annotated[float, Within(0.0, 1.0)] = 0.0  # part of the step, beyond the set point
    drift_K_per_hour: Annotated[float, Within(-1e4, 1e4)] = 0.0  # away from the set point
    swing_K: Annotated[float, Within(0.0, 100.0)] = 0.0  # amplitude of a lasting oscillation
    swing_period_s: Annotated[float, Within(1e-3, 1e5)] = 60.0


class Heater:
    """Temperature of a cavity as a function of a clock's time."""

    def __init__(self, dynamics: Dynamics, clock: Clock, start_K: float) -> None:
        self._dynamics = dynamics
        self._clock = clock
        self._from_K = start_K
        self._since_s = clock.now_s()
        self.setpoint_K = start_K

    def aim(self, setpoint_K: float) -> None:
        """Sets the set point, which the temperature approaches from now on."""
        now_s = self._clock.now_s()
        self._from_K, self._since_s = self._without_swing(now_s), now_s
        self.setpoint_K = setpoint_K

    def now_K(self) -> float:
        return self.temperature_K(self._clock.now_s())

    def temperature_K(self, time_s: float) -> float:
        """True temperature of the cavity at a time of the clock [s]."""
        dynamics = self._dynamics
        swing = (
            dynamics.swing_K * sin(2.0 * pi * time_s / dynamics.swing_period_s)
            if dynamics.swing_K
            else 0.0
        )
        return self._without_swing(time_s) + swing

    def _without_swing(self, time_s: float) -> float:
        dynamics = self._dynamics
        since_s = max(time_s - self._since_s, 0.0)
        drift_K = dynamics.drift_K_per_hour * since_s / 3600.0
        step_K = self._from_K - self.setpoint_K
        tau_s = dynamics.time_constant_s
        left_K = step_K
        # dT/dt = (setpoint - T) / tau, but no faster than the slew rate: a ramp, then a decay.
        if dynamics.slew_K_per_s is not None:
            ramp_K = max(abs(step_K) - dynamics.slew_K_per_s * tau_s, 0.0)
            ramp_s = ramp_K / dynamics.slew_K_per_s
            gone_K = min(since_s, ramp_s) * dynamics.slew_K_per_s
            left_K = step_K - gone_K if step_K > 0.0 else step_K + gone_K
            since_s = max(since_s - ramp_s, 0.0)
        if tau_s == 0.0:
            return (
                self.setpoint_K + (left_K if dynamics.slew_K_per_s is not None else 0.0) + drift_K
            )
        late = since_s / tau_s - _BUMP_FROM
        bump_K = -dynamics.overshoot * step_K * late * exp(1.0 - late) if late > 0.0 else 0.0
        return self.setpoint_K + left_K * exp(-since_s / tau_s) + bump_K + drift_K
