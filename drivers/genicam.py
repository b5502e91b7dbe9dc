"""A GenICam camera's features, each read back after it is written; errors are the rig's."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

from cldit.rig.errors import ConfigRejected, NotConnected

T = TypeVar("T")

_TICKS, _TIMESTAMP_CONTROL, _TIMESTAMP = 0x93C, 0x944, 0x948  # bootstrap registers
_LATCH = (2).to_bytes(4, "big")


class Features:
    """Around a connected viva_genicam.Camera."""

    def __init__(self, camera: Any) -> None:
        self.camera = camera
        self._nodes = frozenset(self.ask(lambda c: c.nodes()))

    def ask(self, action: Callable[[Any], T]) -> T:
        """What `action(camera)` gives. Raises NotConnected, ConfigRejected."""
        import viva_genicam as viva

        try:
            return action(self.camera)
        except viva.TransportError as error:
            raise NotConnected(f"camera: the link failed ({error}); check the cable") from error
        except viva.GenicamError as error:
            raise ConfigRejected(f"camera: {error}") from error

    def integer(self, name: str) -> int:
        return int(self.ask(lambda c: c.get_integer(name)))

    def set_integer(self, name: str, value: int) -> None:
        self.ask(lambda c: c.set_integer(name, value))
        got = self.integer(name)
        if got != value:
            raise ConfigRejected(f"camera: {name}: reads back {got} after {value} was written")

    def choose(self, name: str, entry: str) -> None:
        self.ask(lambda c: c.set_enum(name, entry))
        got = self.ask(lambda c: c.get_enum(name))
        if got != entry:
            raise ConfigRejected(f"camera: {name}: reads back {got} after {entry} was written")

    def has(self, name: str) -> bool:
        return name in self._nodes

    def entries(self, name: str) -> tuple[str, ...]:
        """What a choice allows; nothing where the camera has no such feature."""
        if not self.has(name):
            return ()
        return tuple(self.ask(lambda c: c.available_enum_entries(name)))

    @property
    def _exposure(self) -> str:
        """In microseconds; before SFNC 2 it had another name."""
        return "ExposureTime" if self.has("ExposureTime") else "ExposureTimeAbs"

    def exposure_s(self) -> float:
        return 1e-6 * float(self.ask(lambda c: c.get_float(self._exposure)))

    def expose(self, seconds: float) -> None:
        """To be read back by `exposure_s`."""
        self.ask(lambda c: c.set_float(self._exposure, 1e6 * seconds))

    def exposure_limits_s(self) -> tuple[float, float]:
        limits = self.ask(lambda c: c.feature_state(self._exposure)).range
        return 1e-6 * limits.min, 1e-6 * limits.max

    def stop_after(self, frames: int) -> None:
        """The camera ends by itself after so many frames, where it can count them; else its
        driver reads no more than these."""
        if self.has("AcquisitionFrameCount"):
            self.choose("AcquisitionMode", "MultiFrame")
            self.set_integer("AcquisitionFrameCount", frames)
        else:
            self.choose("AcquisitionMode", "Continuous")

    def trigger(self, source: str | None, activation: str, frames: int) -> None:
        """Each edge at `source` starts so many frames; None: the camera runs freely.

        Several frames are SFNC 2's FrameBurstStart, or the AcquisitionStart of before.

        Raises:
            ConfigRejected: the camera has no such trigger, source or edge.
        """
        selectors = self.entries("TriggerSelector")
        for selector in selectors:  # one that stays on would hold up the others
            self.choose("TriggerSelector", selector)
            self.choose("TriggerMode", "Off")
        if source is None:
            return
        if frames > 1 and "FrameBurstStart" in selectors:
            self.set_integer("AcquisitionBurstFrameCount", frames)
            self.choose("TriggerSelector", "FrameBurstStart")
        elif frames > 1 and "AcquisitionStart" in selectors and self.has("AcquisitionFrameCount"):
            self.choose("TriggerSelector", "AcquisitionStart")
        elif frames > 1:
            raise ConfigRejected(
                "camera: no trigger of it starts several frames; allowed in the plan is frames: 1"
            )
        elif selectors:
            self.choose("TriggerSelector", "FrameStart")
        self.choose("TriggerSource", source)
        if self.has("TriggerActivation"):
            self.choose("TriggerActivation", activation)
        elif activation != "RisingEdge":
            raise ConfigRejected("camera: triggers on the rising edge alone")
        self.choose("TriggerMode", "On")

    def maximum_rate_Hz(self) -> float:
        """Raises ConfigRejected where the camera does not tell it."""
        for name in ("ResultingFrameRate", "AcquisitionFrameRate"):
            if self.has(name):
                return float(self.camera.get_float(name))
        raise ConfigRejected("camera: does not tell its frame rate; give maximum_rate_Hz")

    def clock(self) -> tuple[float, int | None]:
        """Nanoseconds a tick, and what to add to the camera's nanoseconds for wall time: from the
        quickest of some readings; None where the camera has no clock to ask."""
        import viva_genicam as viva

        ns_per_tick, offset_ns, best_ns = 1.0, None, 10**9
        try:
            ticks_per_s = int.from_bytes(self.camera.read_register(_TICKS, 8), "big")
            if ticks_per_s == 0:
                return ns_per_tick, None
            ns_per_tick = 1e9 / ticks_per_s
            for _ in range(5):
                before_ns = time.time_ns()
                self.camera.write_register(_TIMESTAMP_CONTROL, _LATCH)
                after_ns = time.time_ns()
                ticks = int.from_bytes(self.camera.read_register(_TIMESTAMP, 8), "big")
                if after_ns - before_ns < best_ns:
                    best_ns = after_ns - before_ns
                    offset_ns = (before_ns + after_ns) // 2 - round(ticks * ns_per_tick)
        except viva.GenicamError:
            return ns_per_tick, None
        return ns_per_tick, offset_ns
