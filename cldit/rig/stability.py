"""When a background's temperature counts as stable."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from cldit.rig.checks import Thermometer, read_temperature
from cldit.rig.clock import Clock, StopCheck
from cldit.rig.errors import Aborted, DeviceTimeout
from cldit.rig.protocols import Stability


class Settled(Thermometer, Protocol):
    """The part of a background that is asked here."""

    def is_stable(self) -> bool | None:
        """What the controller says; None where it says nothing."""


def wait_stable(
    device: Settled,
    clock: Clock,
    temperature_K: float,
    stability: Stability,
    *,
    should_stop: StopCheck | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> float:
    """Waits until `device` stays at `temperature_K`; gives the last temperature read [K].

    Stable is an unbroken window of hold_s, and settle_s more, in which every reading lies within
    tolerance_K and the controller never says "not stable"; a first crossing is never enough.

    Args:
        device: the background.
        clock: on which to wait.
        temperature_K: set point.
        stability: what counts as stable.
        should_stop: asked while it waits.
        on_progress: called with each temperature read [K].

    Raises:
        DeviceTimeout: timeout_s passed.
        Aborted: `should_stop` said so.
        NotConnected: a reading is no temperature.
    """
    start = clock.now_s()
    poll_s = min(1.0, max(stability.hold_s / 4.0, 0.05))
    since: float | None = None  # when the present unbroken window began
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
            raise Aborted(f"stopped while the background went to {temperature_K:g} K")


class Settling(ABC):
    """Gives a background its `wait_stable`: the one that all of them have."""

    _clock: Clock

    @abstractmethod
    def read_temperature(self) -> float:
        """Present temperature [K]."""

    @abstractmethod
    def is_stable(self) -> bool | None:
        """What the controller says; None where it says nothing."""

    def wait_stable(
        self,
        temperature_K: float,
        stability: Stability,
        should_stop: StopCheck | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> float:
        """Waits as the function of that name does.

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
