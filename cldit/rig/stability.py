"""Stability of a background's temperature."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from cldit.rig.checks import Thermometer, read_temperature
from cldit.rig.clock import Clock, StopCheck
from cldit.rig.errors import Aborted, DeviceTimeout
from cldit.rig.protocols import Stability


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
    start = clock.now_s()
    poll_s = min(1.0, max(stability.hold_s / 4.0, 0.05))
    since: float | None = None  # start of the present unbroken window
    while True:
        reading = read_temperature(device)
        if on_progress is not None:
            on_progress(reading)
        good = abs(reading - temperature_K) <= stability.tolerance_K
        good = good and device.is_stable() is not False
        now = clock.now_s()
        since = (now if since is None else since) if good else None
        held_s = 0.0 if since is None else now - since
        if since is not None and held_s >= stability.hold_s + stability.settle_s:
            return reading
        if now - start >= stability.timeout_s:
            raise DeviceTimeout(
                f"background: {reading:.2f} K after {now - start:.0f} s, not stable at "
                f"{temperature_K:g} K ± {stability.tolerance_K:g} K for {stability.hold_s:g} s; "
                "check the controller, or allow more in the plan's stability.timeout_s"
            )
        if not clock.sleep(poll_s, should_stop):
            raise Aborted(f"stopped while the background approached {temperature_K:g} K")


class Settling(ABC):
    """Base of backgrounds, with the `wait_stable` that all of them share."""

    _clock: Clock

    @abstractmethod
    def read_temperature(self) -> float:
        """Present temperature [K]."""

    @abstractmethod
    def is_stable(self) -> bool | None:
        """The controller's own judgement; None if it has none."""

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
        return wait_stable(
            self,
            self._clock,
            temperature_K,
            stability,
            should_stop=should_stop,
            on_progress=on_progress,
        )
