"""Simulated temperature of a black body's cavity, which approaches its set point."""

from math import exp

from cldit.rig.clock import Clock


class Heater:
    """Temperature of a cavity as a function of a clock's time, a first-order approach."""

    def __init__(self, clock: Clock, start_K: float, time_constant_s: float) -> None:
        self._clock = clock
        self._time_constant_s = time_constant_s
        self._from_K = self.setpoint_K = start_K
        self._since_s = clock.now_s()

    def aim(self, setpoint_K: float) -> None:
        """Sets the set point, which the temperature approaches from now on."""
        now_s = self._clock.now_s()
        self._from_K, self._since_s = self.temperature_K(now_s), now_s
        self.setpoint_K = setpoint_K

    def now_K(self) -> float:
        return self.temperature_K(self._clock.now_s())

    def temperature_K(self, time_s: float) -> float:
        """True temperature of the cavity at a time of the clock [s]."""
        if self._time_constant_s == 0.0:
            return self.setpoint_K
        since_s = max(time_s - self._since_s, 0.0)
        step_K = self._from_K - self.setpoint_K
        return self.setpoint_K + step_K * exp(-since_s / self._time_constant_s)
