"""The injected clock, and waiting for a stable background on it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import pytest

from cldit.rig.clock import Clock, SimulatedClock
from cldit.rig.errors import Aborted, DeviceTimeout, NotConnected
from cldit.rig.protocols import Stability
from cldit.rig.stability import wait_stable


def test_simulated_time_is_free_and_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail(f"waits {seconds:g} s"))
    clock = SimulatedClock()
    assert clock.sleep(7200.0) and clock.now_s() == 7200.0
    assert clock.wall_time() == "2000-01-01T02:00:00.000000+00:00"
    clock.sleep(-5.0)
    assert clock.now_s() == 7200.0


def test_simulated_time_only_goes_forward() -> None:
    clock = SimulatedClock()
    clock.catch_up(clock.epoch_s() + 100.0)
    assert clock.now_s() == 100.0
    clock.catch_up(0.0)
    assert clock.now_s() == 100.0


def test_real_time_factor() -> None:
    """0.1 s at a factor of 100: sleeping may take longer on a busy machine, never shorter."""
    clock = SimulatedClock(real_time_factor=100.0)
    real = time.monotonic()
    clock.sleep(10.0)
    assert time.monotonic() - real >= 0.1 and clock.now_s() == pytest.approx(10.0)


@pytest.mark.parametrize("clock", [Clock(), SimulatedClock(real_time_factor=1.0)])
def test_a_sleep_can_be_stopped(clock: Clock) -> None:
    asked = 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > 2

    assert not clock.sleep(600.0, stop)
    assert asked == 3
    assert clock.sleep(0.0, lambda: False)


class Thermometer:
    """Shows a given course of temperature over time."""

    def __init__(
        self, clock: Clock, course: Callable[[float], float], flag: bool | None = None
    ) -> None:
        self._clock, self._course, self._flag = clock, course, flag

    def read_temperature(self) -> float:
        return self._course(self._clock.now_s())

    def is_stable(self) -> bool | None:
        return self._flag


RULE = Stability(tolerance_K=0.5, hold_s=20.0, settle_s=10.0, timeout_s=500.0)


def test_first_order_approach() -> None:
    """Within tolerance at tau ln(100 / 0.5) = 529.8 s / 10; then hold and settle; 1 s polls."""
    clock = SimulatedClock()
    device = Thermometer(clock, lambda t: 400.0 - 100.0 * math.exp(-t / 10.0))
    wait_stable(device, clock, 400.0, RULE)
    assert 10.0 * math.log(200.0) + 30.0 <= clock.now_s() <= 10.0 * math.log(200.0) + 32.0


def test_a_crossing_is_not_stable() -> None:
    """A damped swing through the set point: only after the last time outside does it count."""
    clock = SimulatedClock()

    def swing(t: float) -> float:
        return 400.0 + 20.0 * math.exp(-t / 30.0) * math.cos(t / 5.0)

    final = max(t for t in range(500) if abs(swing(t) - 400.0) > 0.5)
    wait_stable(Thermometer(clock, swing), clock, 400.0, RULE)
    assert clock.now_s() == final + 1 + 30


def test_neither_the_flag_alone_nor_without_it() -> None:
    clock = SimulatedClock()
    with pytest.raises(DeviceTimeout):  # the controller says stable, 5 K off
        wait_stable(Thermometer(clock, lambda t: 395.0, True), clock, 400.0, RULE)
    with pytest.raises(DeviceTimeout):  # the temperature is right, the controller says no
        wait_stable(Thermometer(clock, lambda t: 400.0, False), clock, 400.0, RULE)
    assert wait_stable(Thermometer(clock, lambda t: 400.0, True), clock, 400.0, RULE) == 400.0


@pytest.mark.parametrize("reading_K", [math.nan, math.inf, -math.inf, 0.0, -300.0])
def test_what_is_no_temperature_is_an_error(reading_K: float) -> None:
    clock = SimulatedClock()
    with pytest.raises(NotConnected, match=r"answered .* K to read_temperature\(\)"):
        wait_stable(Thermometer(clock, lambda t: reading_K), clock, 400.0, RULE)


def test_stop_and_progress() -> None:
    clock = SimulatedClock()
    seen: list[float] = []
    with pytest.raises(Aborted):
        wait_stable(
            Thermometer(clock, lambda t: 300.0 + t),
            clock,
            400.0,
            RULE,
            should_stop=lambda: clock.now_s() > 4.5,
            on_progress=seen.append,
        )
    assert seen == [300.0, 301.0, 302.0, 303.0, 304.0, 305.0]
