"""Protocols of a camera, a filter wheel, a background and a trigger generator.

A driver implements one of them. It does no I/O in `__init__`, blocks until done, and raises the
errors of `cldit.rig.errors` and no others.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, model_validator

from cldit.camera.calibration import Calibration
from cldit.rig.clock import StopCheck
from cldit.scene.checks import Section, Within
from cldit.scene.values import Filter

KINDS = {
    "camera": "the camera may still be armed",
    "filter_wheel": "the filter wheel may still move",
    "background": "the black body may still be hot",
    "trigger": "the generator may still inject on a trigger",
}
"""Kinds of devices in the order of connection, each with the danger of one that is left on."""


class TriggerMode(StrEnum):
    """Source of the signal that starts an exposure."""

    INTERNAL = "internal"
    SOFTWARE = "software"
    EXTERNAL_EDGE = "external_edge"
    EXTERNAL_LEVEL = "external_level"


@dataclass(frozen=True)
class DeviceInfo:
    """Identity of an instrument; `simulated` and `tested_on_hardware` are shown with the rig."""

    kind: str
    maker: str
    model: str
    serial: str = ""
    firmware: str = ""
    simulated: bool = False
    tested_on_hardware: bool = True


@dataclass(frozen=True)
class Frame:
    """One image: data (h, w) uint16, row 0 at the top, raw counts.

    frame_id counts the triggers that the camera accepted, without gaps; device_timestamp_ns is on
    the camera's own clock, host_timestamp_ns is wall time.
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
    """Settings of the camera as read back from it."""

    integration_time_s: float
    roi: Roi
    pixel_format: str


@dataclass(frozen=True)
class Capabilities:
    """Capabilities of a camera."""

    trigger_modes: frozenset[TriggerMode]
    integration_time_limits_s: tuple[float, float]
    minimum_period_s: float
    saturation_counts: int
    sensor_pixels: tuple[int, int]  # columns, rows
    pixel_formats: tuple[str, ...]


@dataclass(frozen=True)
class TriggerInfo:
    """Trigger of an armed camera, which stops by itself after `n_frames`.

    frames_per_trigger: frames that an external edge starts, at the camera's own rate.
    """

    mode: TriggerMode
    n_frames: int = 1
    frames_per_trigger: int = 1
    activation: str = "rising"


@dataclass(frozen=True)
class Burst:
    """A burst of n pulses, each with an edge for the camera and the injector after their delays.

    widths_s: widths of the camera's and the injector's pulse. Without `inject` the injector gets no
    pulse: a reference image.
    """

    n: int = 1
    period_s: float = 0.1
    camera_delay_s: float = 0.0
    injector_delay_s: float = 0.0
    widths_s: tuple[float, float] = (1e-4, 1.5e-3)
    inject: bool = False


class Stability(Section):
    """Criterion of a stable background; see `cldit.rig.stability.wait_stable`."""

    tolerance_K: Annotated[float, Within(1e-3, 100.0)] = 0.2
    """Largest difference of readings from the set point."""
    hold_s: Annotated[float, Within(0.0, 1e6)] = 30.0
    """Time for which readings must stay within the tolerance."""
    settle_s: Annotated[float, Within(0.0, 1e6)] = 30.0
    """Additional waiting time."""
    timeout_s: Annotated[float, Within(0.1, 1e7)] = 3600.0
    """Time after which the run stops with an error."""


@dataclass(frozen=True)
class Limits:
    """Limits of a background's set point."""

    low_K: float
    high_K: float


@dataclass(frozen=True)
class Safety:
    """Result of `make_safe`, which is checked and stored.

    connected: False if there was nothing to do because the device was never connected, which is a
    failure for a device that was. did: the actions, in words.
    """

    connected: bool
    did: str


def _name(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}", value):
        raise ValueError(f"{value!r} is no name; allowed: up to 40 letters, digits, `_`, `.`, `-`")
    return value


FilterName = Annotated[str, AfterValidator(_name)]
"""Name of a spectral filter, which names a folder too."""


class SpectralFilter(Section):
    """A filter of a wheel, with the camera's calibration through it."""

    position: Annotated[int, Within(1, 100)]
    """Position in the wheel, from 1."""
    name: FilterName
    """Name in plans."""
    filter_um: Filter
    """Two edges, pairs of wavelength (um) and transmission, or a file of pairs."""
    integration_time_s: Annotated[float, Within(1e-9, 10.0)]
    """Exposure at which `counts_per_radiance` was measured."""
    counts_per_radiance: Annotated[float, Within(1e-40, 1e10)]
    """Counts per photon s-1 m-2 sr-1 of the camera through this filter."""
    offset_counts: Annotated[float, Within(-1e6, 1e6)] | None = None
    """Counts without radiation through this filter; by default those of the camera."""

    @model_validator(mode="after")
    def _rising(self) -> "SpectralFilter":
        low, high = self.filter_um[0], self.filter_um[-1]
        if isinstance(low, float) and isinstance(high, float) and not low < high:
            raise ValueError(
                f"filter_um: {low:g} to {high:g} is empty; allowed: a lower and a higher wavelength"
            )
        return self

    def calibration(self, camera: Mapping[str, Any]) -> dict[str, Any]:
        """The camera's calibration through this filter, as `Calibration.to_dict`.

        Args:
            camera: the camera's configuration, with `calibration` and `integration_time_s`.
        """
        scale = camera["integration_time_s"] / self.integration_time_s
        own = {
            "filter_um": self.filter_um,
            "counts_per_radiance": scale * self.counts_per_radiance,
            **({} if self.offset_counts is None else {"offset_counts": self.offset_counts}),
        }
        return Calibration.from_dict({**camera["calibration"], **own}).to_dict()


def _distinct(filters: tuple[SpectralFilter, ...]) -> tuple[SpectralFilter, ...]:
    for key in ("position", "name"):
        values = [getattr(item, key) for item in filters]
        if twice := next((value for value in values if values.count(value) > 1), None):
            raise ValueError(f"{key}: {twice} twice; allowed: each filter once")
    if not filters:
        raise ValueError("none; allowed: one filter or more")
    return filters


SpectralFilters = Annotated[tuple[SpectralFilter, ...], AfterValidator(_distinct)]
"""Filters of a wheel: one or more, with different names and positions."""


class Device(Protocol):
    """An instrument of any kind."""

    def connect(self, timeout_s: float = 10.0) -> None:
        """Connects, unless connected already; raises NotConnected."""

    def close(self) -> None:
        """Releases the instrument; does nothing if it is not connected."""

    def identify(self) -> DeviceInfo:
        """Maker, model, serial number, and if it is simulated."""

    def read_configuration(self) -> dict[str, Any]:
        """Present settings as plain data for JSON; stored with every acquisition."""

    def make_safe(self) -> Safety:
        """Makes the instrument harmless and leaves it usable; idempotent, bounded in time.

        If the connection was lost, connects again. Raises NotSafe if that fails: it never returns
        normally from an instrument that may be on.
        """


class Camera(Device, Protocol):
    """`read_configuration()["calibration"]` is a `cldit.camera.sensor.Calibration` as a dict.

    Of a camera whose settings change counts, it also has `features`, their values by name, and
    `unstated`, a list of those that the rig file does not state.
    """

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities, known once connected."""

    def wait_ready(self, timeout_s: float) -> None:
        """Waits for cooler and non-uniformity correction; raises DeviceTimeout."""

    def configure(
        self, integration_time_s: float, roi: Roi | None = None, pixel_format: str | None = None
    ) -> Settings:
        """Sets exposure, region and format.

        Args:
            integration_time_s: exposure.
            roi: part of the sensor; None is all of it.
            pixel_format: None is the widest.

        Raises:
            OutOfLimits, ConfigRejected: the camera does not accept them.
        """

    def prepare(self, trigger: TriggerInfo) -> None:
        """Sets the trigger; raises ConfigRejected if the camera does not support it."""

    def arm(self) -> None:
        """Arms the camera: the next trigger starts an exposure."""

    def flush(self) -> int:
        """Discards the frames in the buffer, and returns their number."""

    def software_trigger(self) -> None:
        """Triggers an armed camera in mode SOFTWARE."""

    def read_frames(self, n: int, timeout_s: float) -> Iterator[Frame]:
        """Yields the next `n` frames; raises MissingFrames when `timeout_s` passes without one."""

    def disarm(self) -> None:
        """Disarms the camera: triggers are ignored from now on."""

    def statistics(self) -> dict[str, int]:
        """Counts, at least `delivered`, `missed` (triggers not accepted) and `flushed`."""


class FilterWheel(Device, Protocol):
    """A wheel of spectral filters in front of the camera.

    `read_configuration()["filters"]` has every `SpectralFilter` as plain data.
    """

    @property
    def filters(self) -> tuple[SpectralFilter, ...]:
        """Filters with different names and positions, known once connected."""

    @property
    def moving_s(self) -> float:
        """Longest time of a move."""

    def move(self, name: str) -> None:
        """Moves to a filter, and returns when the wheel reads that it is there.

        Args:
            name: of one of `filters`.

        Raises:
            ConfigRejected: there is no such filter; nothing moved.
            DeviceTimeout: the wheel is not there after `moving_s`; it may be anywhere.
        """

    def read_filter(self) -> str | None:
        """Name of the filter at the position read, None if there is none; raises NotConnected."""


class Background(Device, Protocol):
    """The black body's controller."""

    @property
    def limits(self) -> Limits:
        """Limits of the set point."""

    def set_setpoint(self, temperature_K: float) -> float:
        """Sets the set point, and returns it as read back; raises OutOfLimits before any change."""

    def read_temperature(self) -> float:
        """Temperature [K], finite; raises NotConnected, also for an impossible answer."""

    def is_stable(self) -> bool | None:
        """The controller's own judgement, None if it has none; never relied on alone."""

    def wait_stable(
        self,
        temperature_K: float,
        stability: Stability,
        should_stop: StopCheck | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> float:
        """Waits with `cldit.rig.stability.wait_stable`.

        Args:
            temperature_K, stability, should_stop, on_progress: as there.
        """


class TriggerGenerator(Device, Protocol):
    """Generator of the pulses that trigger the camera and, on request, the injector."""

    def configure(self, burst: Burst) -> Burst:
        """Sets a burst, returns it as quantised, and ends `inhibit`; raises ConfigRejected."""

    def fire(self) -> None:
        """Sends the configured burst once; raises FireUncertain if that is unconfirmed."""

    def wait_done(self, timeout_s: float) -> None:
        """Waits for the end of the burst; raises DeviceTimeout."""

    def inhibit(self) -> None:
        """Prevents all pulses until `configure` is called again."""

    def abort(self) -> None:
        """Stops a burst; the rest of its pulses are never sent."""
