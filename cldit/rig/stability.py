"""Stability of a background's temperature, and its fall once it was made safe."""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from statistics import fmean
from typing import Protocol

from cldit.rig.checks import Thermometer, read_temperature
from cldit.rig.clock import Clock, StopCheck
from cldit.rig.errors import Aborted, DeviceTimeout, NotSafe
from cldit.rig.protocols import Limits, Stability

_COLD_K = 5.0  # a body at rest in a room of 300 K, above the usual safe set point of 295 K
# A body with a time constant of 100 min falls by 1 % of its excess in 60 s. A fall of 0.5 K is five
# standard deviations of a mean of ten readings with a noise of 0.3 K.
WATCH_s, _WATCH_POLL_s = 60.0, 0.5
_FALL, _LEAST_FALL_K, _MEAN_OF = 0.01, 0.5, 10


class Settled(Thermometer, Protocol):
    """A background, as far as its temperature and its stability."""

    def is_stable(self) -> bool | None:
        """The controller's own judgement; None if it has none."""


def wait_stable(
    device: Settled,
    clock: Clock,
    temperature_K: float,
    stability: Stability,
    *,
    should_stop: StopCheck | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> float:
    """Waits until a background stays at a temperature; returns the last temperature read [K].

    It is stable after an unbroken window of hold_s + settle_s in which every reading is within
    tolerance_K and the controller never reports the contrary; a first crossing is not enough.

    Args:
        device: the background.
        clock: on which to wait.
        temperature_K: set point.
        stability: the criterion.
        should_stop: called during the wait; True ends it.
        on_progress: called with each temperature read [K].

    Raises:
        DeviceTimeout: timeout_s passed.
        Aborted: `should_stop` returned True.
        NotConnected: a reading is not a temperature.
    """
    start_s = clock.now_s()
    poll_s = min(1.0, max(stability.hold_s / 4.0, 0.05))
    since_s: float | None = None  # start of the present unbroken window
    while True:
        reading_K = read_temperature(device)
        if on_progress is not None:
            on_progress(reading_K)
        good = abs(reading_K - temperature_K) <= stability.tolerance_K
        good = good and device.is_stable() is not False
        now_s = clock.now_s()
        since_s = (now_s if since_s is None else since_s) if good else None
        held_s = 0.0 if since_s is None else now_s - since_s
        if since_s is not None and held_s >= stability.hold_s + stability.settle_s:
            return reading_K
        if now_s - start_s >= stability.timeout_s:
            raise DeviceTimeout(
                f"background: {reading_K:.2f} K after {now_s - start_s:.0f} s, not stable at "
                f"{temperature_K:g} K ± {stability.tolerance_K:g} K for {stability.hold_s:g} s; "
                "check the controller, or allow more in the plan's stability.timeout_s"
            )
        if not clock.sleep(poll_s, should_stop):
            raise Aborted(f"stopped while the background approached {temperature_K:g} K")


def watch_cooling(device: Thermometer, clock: Clock, safe_K: float) -> str:
    """Watches a background at its safe set point until it is seen to cool; describes it.

    A set point alone cools nothing where the controller is in manual output. Raises NotSafe unless
    the temperature is within 5 K of `safe_K`, or falls within 60 s by 1 % of its excess; raises
    NotConnected if it cannot be read.
    """
    end_s = clock.now_s() + WATCH_s
    first_K = reading_K = read_temperature(device)
    if first_K <= safe_K + _COLD_K:
        return f"cold at {first_K:.1f} K"
    recent_K = deque([first_K], _MEAN_OF)
    highest_K = -math.inf  # mean
    while clock.now_s() < end_s:
        clock.sleep(_WATCH_POLL_s)
        reading_K = read_temperature(device)
        recent_K.append(reading_K)
        if len(recent_K) == _MEAN_OF:
            mean_K = fmean(recent_K)
            highest_K = max(highest_K, mean_K)
            if mean_K <= highest_K - max(_FALL * (first_K - safe_K), _LEAST_FALL_K):
                return f"falls to {reading_K:.1f} K"
    raise NotSafe(
        f"it does not cool: {first_K:.1f} K, and {reading_K:.1f} K after {WATCH_s:.0f} s; is it "
        "in manual output, at a second set point, on hold in a ramp, or in another unit?"
    )


class Settling(ABC):
    """Base of backgrounds, with `wait_stable` and `watch_cooling`, which all of them share."""

    _clock: Clock

    @property
    @abstractmethod
    def limits(self) -> Limits:
        """Limits of the set point."""

    @property
    def safe_setpoint_K(self) -> float:
        """Set point of make_safe(); the lowest, unless a driver has another."""
        return self.limits.low_K

    @abstractmethod
    def read_temperature(self) -> float:
        """Present temperature [K]."""

    @abstractmethod
    def is_stable(self) -> bool | None:
        """The controller's own judgement; None if it has none."""

    def watch_cooling(self) -> str:
        """Watches as the function of that name, after make_safe()."""
        with getattr(self, "observed", nullcontext)():
            return watch_cooling(self, self._clock, self.safe_setpoint_K)

    def wait_stable(
        self,
        temperature_K: float,
        stability: Stability,
        should_stop: StopCheck | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> float:
        """Waits as the function of that name.

        Args:
            temperature_K, stability, should_stop, on_progress: as there.
        """
        wait = partial(wait_stable, self, self._clock, temperature_K, stability)
        return wait(should_stop=should_stop, on_progress=on_progress)
