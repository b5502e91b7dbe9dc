"""What every driver of a kind refuses, in the same words; for drivers of other packages too."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import asdict
from typing import Any, Protocol

from cldit.rig.errors import ConfigRejected, NotConnected, OutOfLimits
from cldit.rig.protocols import Burst, Capabilities, Limits, Roi, TriggerInfo, TriggerMode

EDGES = ("rising", "falling")
_SCPI_NONE = 9.9e37  # 9.9E37 is infinity, 9.91E37 not a number (SCPI 1999, volume 1, 7.2.1.4-5)
_HOTTEST_K = 1e4


class Thermometer(Protocol):
    """The part of a background that is asked here."""

    def read_temperature(self) -> float:
        """Present temperature [K]."""


def check_answer(kind: str, query: str, answer: str | float) -> float:
    """The number that an instrument gives.

    Args:
        kind: of instrument, for the message.
        query: that was asked.
        answer: that came.

    Raises:
        NotConnected: the answer is no finite number, so that the link is not to be trusted.
    """
    try:
        value = float(answer)
    except ValueError:
        value = math.nan
    if not abs(value) < _SCPI_NONE:
        raise NotConnected(
            f"{kind}: {answer!r} came for {query}, expected a finite number; is another program "
            "talking to it?"
        )
    return value


def check_temperature(kind: str, query: str, temperature_K: float) -> float:
    """Gives the temperature back, where anything can be so hot.

    Args:
        kind: of instrument, for the message.
        query: that was asked.
        temperature_K: that came.

    Raises:
        NotConnected: nothing can be so hot or so cold.
    """
    if not 0.0 < temperature_K < _HOTTEST_K:
        raise NotConnected(
            f"{kind}: {temperature_K:g} K came for {query}, expected 0 to {_HOTTEST_K:g} K; is "
            "another program talking to it?"
        )
    return temperature_K


def read_temperature(background: Thermometer) -> float:
    """Kelvin. Raises NotConnected where the driver gives what cannot be a temperature."""
    return check_temperature("background", "read_temperature()", background.read_temperature())


def check_exposure(can: Capabilities, integration_time_s: float) -> None:
    """Raises OutOfLimits where a camera that `can` this does not take `integration_time_s`."""
    low, high = can.integration_time_limits_s
    if not low <= integration_time_s <= high:
        raise OutOfLimits(
            f"camera: integration_time_s: {integration_time_s:g} is outside {low:g}..{high:g}"
        )


def check_roi(can: Capabilities, roi: Roi | None) -> Roi:
    """The part `roi` of the sensor of a camera that `can` this; None stands for all of it.

    Raises:
        OutOfLimits: it does not fit on the sensor.
    """
    columns, rows = can.sensor_pixels
    part = Roi(0, 0, columns, rows) if roi is None else roi
    inside = part.x >= 0 and part.y >= 0 and part.width > 0 and part.height > 0
    if not inside or part.x + part.width > columns or part.y + part.height > rows:
        raise OutOfLimits(f"camera: roi: {part} does not fit on {columns} x {rows}")
    return part


def check_format(can: Capabilities, pixel_format: str | None) -> None:
    """Raises ConfigRejected where a camera that `can` this lacks `pixel_format`; None is fine."""
    if pixel_format is not None and pixel_format not in can.pixel_formats:
        raise ConfigRejected(
            f"camera: pixel_format: {pixel_format!r}; allowed: {', '.join(can.pixel_formats)}"
        )


def check_trigger(modes: Collection[TriggerMode], trigger: TriggerInfo) -> None:
    """Raises ConfigRejected where a camera with these `modes` cannot take this `trigger`."""
    enough = min(trigger.n_frames, trigger.frames_per_trigger) >= 1
    if trigger.mode not in modes or not enough or trigger.activation not in EDGES:
        raise ConfigRejected(
            f"camera: {trigger}; allowed are {', '.join(sorted(modes))}, 1 frame or more, and "
            f"{' or '.join(EDGES)}"
        )


def check_setpoint(limits: Limits, temperature_K: float) -> None:
    """Raises OutOfLimits where `temperature_K` is outside `limits`."""
    if not limits.low_K <= temperature_K <= limits.high_K:
        raise OutOfLimits(
            f"background: {temperature_K:g} K is outside {limits.low_K:g}..{limits.high_K:g} K"
        )


def check_burst(burst: Burst) -> None:
    """Raises ConfigRejected."""
    delays = (burst.camera_delay_s, burst.injector_delay_s)
    last_s = max(d + w for d, w in zip(delays, burst.widths_s, strict=True))
    good = all(delay >= 0.0 for delay in delays) and all(width > 0.0 for width in burst.widths_s)
    if burst.n < 1 or not good:
        raise ConfigRejected(f"trigger: {burst}: allowed are n >= 1, delays >= 0, widths > 0")
    if burst.n > 1 and not burst.period_s >= last_s:
        raise ConfigRejected(
            f"trigger: period_s: {burst.period_s:g} is shorter than one shot, {last_s:g}"
        )


def plain_burst(burst: Burst | None) -> dict[str, Any] | None:
    """A burst as JSON can hold it."""
    return None if burst is None else {**asdict(burst), "widths_s": list(burst.widths_s)}
