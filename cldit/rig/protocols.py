"""What the acquisition asks of a camera, a background and a trigger generator.

A driver is the smallest thing that meets one of these Protocols. It does no I/O in `__init__`,
blocks until done, and raises the errors of `cldit.rig.errors` and no others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.rig.clock import StopCheck


class TriggerMode(StrEnum):
    """What starts an exposure."""

    INTERNAL = "internal"
    SOFTWARE = "software"
    EXTERNAL_EDGE = "external_edge"
    EXTERNAL_LEVEL = "external_level"


@dataclass(frozen=True)
class DeviceInfo:
    """Who answers. `simulated` and `tested_on_hardware` are shown wherever a user sees the rig."""

    kind: str
    maker: str
    model: str
    serial: str = ""
    firmware: str = ""
    simulated: bool = False
    tested_on_hardware: bool = True


@dataclass(frozen=True)
class Frame:
    """One picture: data (h, w) uint16, row 0 at the top, raw counts.

    frame_id counts the triggers that the camera took, without gaps; device_timestamp_ns is on the
    camera's own clock, host_timestamp_ns is wall time.
    """

    data: NDArray[np.uint16]
    frame_id: int
    device_timestamp_ns: int
    host_timestamp_ns: int
    complete: bool = True
    meta: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Roi:
    """Part of the sensor, in pixels from the top left."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class Settings:
    """The camera's settings as it reads them back."""

    integration_time_s: float
    roi: Roi
    pixel_format: str


@dataclass(frozen=True)
class Capabilities:
    """What the camera can do."""

    trigger_modes: frozenset[TriggerMode]
    integration_time_limits_s: tuple[float, float]
    minimum_period_s: float
    saturation_counts: int
    sensor_pixels: tuple[int, int]  # columns, rows
    pixel_formats: tuple[str, ...]


@dataclass(frozen=True)
class TriggerInfo:
    """How frames are started once the camera is armed; it stops by itself after `n_frames`.

    frames_per_trigger: an external edge starts so many, at the camera's own rate.
    """

    mode: TriggerMode
    n_frames: int = 1
    frames_per_trigger: int = 1
    activation: str = "rising"


@dataclass(frozen=True)
class Burst:
    """n pulses; in each, the camera's and the injector's edge after their delays.

    widths_s are those of the camera's and the injector's pulse. Without `inject` the injector's
    line stays still: a reference picture.
    """

    n: int = 1
    period_s: float = 0.1
    camera_delay_s: float = 0.0
    injector_delay_s: float = 0.0
    widths_s: tuple[float, float] = (1e-4, 1.5e-3)
    inject: bool = False


@dataclass(frozen=True)
class Stability:
    """Stable: within tolerance_K for hold_s and settle_s more, without a break."""

    tolerance_K: float
    hold_s: float
    settle_s: float
    timeout_s: float


@dataclass(frozen=True)
class Limits:
    """Set points that the background takes."""

    low_K: float
    high_K: float


@dataclass(frozen=True)
class Safety:
    """What `make_safe` did, which is checked and stored.

    connected: False where there was nothing to do, because the device was never connected; whoever
    connected it takes that for a failure. did: in words.
    """

    connected: bool
    did: str


class Device(Protocol):
    """An instrument, whatever it is."""

    def connect(self, timeout_s: float = 10.0) -> None:
        """Raises NotConnected; does nothing where it is connected already."""

    def close(self) -> None:
        """Lets go of the instrument; does nothing where it is not connected."""

    def identify(self) -> DeviceInfo:
        """Maker, model, serial number; whether it is simulated."""

    def read_configuration(self) -> dict[str, Any]:
        """Present settings, as JSON can hold them; stored with every acquisition."""

    def make_safe(self) -> Safety:
        """Leaves the instrument harmless and usable. Idempotent, bounded in time.

        An instrument that was connected and lost is reached for again. Raises NotSafe where that
        fails: it never returns from an instrument that may be on.
        """


class Camera(Device, Protocol):
    """`read_configuration()["calibration"]` is a `cldit.camera.sensor.Calibration` as a dict."""

    @property
    def capabilities(self) -> Capabilities:
        """What the camera can do; known once it is connected."""

    def wait_ready(self, timeout_s: float) -> None:
        """Cooler and non-uniformity correction; raises DeviceTimeout."""

    def configure(
        self, integration_time_s: float, roi: Roi | None = None, pixel_format: str | None = None
    ) -> Settings:
        """Sets exposure, region and format.

        Args:
            integration_time_s: exposure.
            roi: part of the sensor; None is all of it.
            pixel_format: None is the widest.

        Raises:
            OutOfLimits, ConfigRejected: the camera does not take them.
        """

    def prepare(self, trigger: TriggerInfo) -> None:
        """Raises ConfigRejected where the camera cannot be started that way."""

    def arm(self) -> None:
        """The next trigger starts an exposure."""

    def flush(self) -> int:
        """Throws away what lies in the buffer; how many frames that were."""

    def software_trigger(self) -> None:
        """Triggers an armed camera in mode SOFTWARE."""

    def read_frames(self, n: int, timeout_s: float) -> Iterator[Frame]:
        """Yields the next `n` frames; raises MissingFrames when `timeout_s` passes without one."""

    def disarm(self) -> None:
        """Triggers are ignored from now on."""

    def statistics(self) -> dict[str, int]:
        """Counts, at least `delivered`, `missed` (triggers not taken) and `flushed`."""


class Background(Device, Protocol):
    """The black body's controller."""

    @property
    def limits(self) -> Limits:
        """The set points that the background takes."""

    def set_setpoint(self, temperature_K: float) -> float:
        """The set point as read back. Raises OutOfLimits before anything moves."""

    def read_temperature(self) -> float:
        """Kelvin, finite. Raises NotConnected, also for an answer that is no temperature."""

    def is_stable(self) -> bool | None:
        """The controller's own opinion, None where it has none. Never relied on alone."""

    def wait_stable(
        self,
        temperature_K: float,
        stability: Stability,
        should_stop: StopCheck | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> float:
        """Waits as `cldit.rig.stability.wait_stable` does, which drivers call.

        Args:
            temperature_K, stability, should_stop, on_progress: as there.
        """


class TriggerGenerator(Device, Protocol):
    """Triggers the camera, and the injector where it is asked to."""

    def configure(self, burst: Burst) -> Burst:
        """The burst as the instrument quantises it; lifts `inhibit`. Raises ConfigRejected."""

    def fire(self) -> None:
        """Sends the configured burst, once. Raises FireUncertain where nobody knows."""

    def wait_done(self, timeout_s: float) -> None:
        """Raises DeviceTimeout."""

    def inhibit(self) -> None:
        """Nothing fires until `configure` is called again."""

    def abort(self) -> None:
        """Stops a burst; pulses not sent yet are never sent."""
