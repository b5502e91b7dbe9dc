"""Checks that all drivers of a kind share, with the same messages; also for other packages."""

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any, Protocol

from cldit.rig.errors import ConfigRejected, OddAnswer, OutOfLimits
from cldit.rig.protocols import Burst, Capabilities, Limits, Roi, TriggerInfo, TriggerMode

ROUNDING = 0.01
"""Relative difference of a setting from the value read back that is rounding: a step of 0.1 us of a
camera's exposure of 25 us is 0.4 %, one of 10 mV of a level of 2 V 0.5 %."""
EDGES = ("rising", "falling")
_SCPI_NONE = 9.9e37  # 9.9E37 is infinity, 9.91E37 not a number (SCPI 1999, volume 1, 7.2.1.4-5)
_HOTTEST_K = 1e4  # no solid or liquid is as hot


class Thermometer(Protocol):
    """A background, as far as its temperature."""

    def read_temperature(self) -> float:
        """Present temperature [K]."""


def check_answer(kind: str, query: str, answer: str | float) -> float:
    """Converts an instrument's answer to a query to a finite number.

    Raises OddAnswer, which names the kind of instrument, if it is none: the link is unreliable.
    """
    try:
        value = float(answer)
    except ValueError:
        value = math.nan
    if not abs(value) < _SCPI_NONE:
        raise OddAnswer(
            f"{kind}: answered {answer!r} to {query}, expected a finite number; is another program "
            "using it?"
        )
    return value


def check_temperature(kind: str, query: str, temperature_K: float) -> float:
    """Returns the temperature that an instrument of this kind gave in answer to a query.

    Raises OddAnswer if nothing can be so hot or so cold.
    """
    if not 0.0 < temperature_K < _HOTTEST_K:
        raise OddAnswer(
            f"{kind}: answered {temperature_K:g} K to {query}, expected 0 to {_HOTTEST_K:g} K; is "
            "another program using it?"
        )
    return float(temperature_K)  # a driver may give a number of numpy, which JSON does not take


def read_temperature(background: Thermometer) -> float:
    """Temperature of a background [K]; raises NotConnected for an impossible one."""
    return check_temperature("background", "read_temperature()", background.read_temperature())


def check_exposure(can: Capabilities, integration_time_s: float) -> None:
    """Raises OutOfLimits if the exposure is outside the camera's limits."""
    low, high = can.integration_time_limits_s
    if not low <= integration_time_s <= high:
        raise OutOfLimits(
            f"camera: integration_time_s: {integration_time_s:g} is outside {low:g}..{high:g}"
        )


def check_roi(can: Capabilities, roi: Roi | None) -> Roi:
    """Returns the part of the sensor, all of it for None; raises OutOfLimits if it does not fit."""
    columns, rows = can.sensor_pixels
    part = Roi(0, 0, columns, rows) if roi is None else roi
    inside = part.x >= 0 and part.y >= 0 and part.width > 0 and part.height > 0
    if not inside or part.x + part.width > columns or part.y + part.height > rows:
        raise OutOfLimits(f"camera: roi: {part} does not fit on {columns} x {rows}")
    return part


def check_format(can: Capabilities, pixel_format: str | None) -> None:
    """Raises ConfigRejected if the camera lacks the pixel format; None is accepted."""
    if pixel_format is not None and pixel_format not in can.pixel_formats:
        raise ConfigRejected(
            f"camera: pixel_format: {pixel_format!r}; allowed: {', '.join(can.pixel_formats)}"
        )


def check_trigger(modes: Collection[TriggerMode], trigger: TriggerInfo) -> None:
    """Raises ConfigRejected if a camera with these modes cannot be triggered this way."""
    enough = min(trigger.n_frames, trigger.frames_per_trigger) >= 1
    if trigger.mode not in modes or not enough or trigger.activation not in EDGES:
        raise ConfigRejected(
            f"camera: {trigger}; allowed: {', '.join(sorted(modes))}, 1 frame or more, and "
            f"{' or '.join(EDGES)}"
        )


def check_filter(positions: Mapping[str, int], name: str) -> int:
    """Returns the position of a filter by its name; raises ConfigRejected if there is none."""
    if name not in positions:
        allowed = ", ".join(positions)
        raise ConfigRejected(f"filter_wheel: {name}: no such filter; allowed: {allowed}")
    return positions[name]


def check_setpoint(limits: Limits, temperature_K: float) -> None:
    """Raises OutOfLimits if the set point is outside the limits."""
    if not limits.low_K <= temperature_K <= limits.high_K:
        raise OutOfLimits(
            f"background: {temperature_K:g} K is outside {limits.low_K:g}..{limits.high_K:g} K"
        )


def check_burst(burst: Burst) -> None:
    """Raises ConfigRejected if no generator can send the burst."""
    delays = (burst.camera_delay_s, burst.injector_delay_s)
    last_s = max(d + w for d, w in zip(delays, burst.widths_s, strict=True))
    good = all(delay >= 0.0 for delay in delays) and all(width > 0.0 for width in burst.widths_s)
    if burst.n < 1 or not good:
        raise ConfigRejected(f"trigger: {burst}: allowed: n >= 1, delays >= 0, widths > 0")
    if burst.n > 1 and not burst.period_s >= last_s:
        raise ConfigRejected(
            f"trigger: period_s: {burst.period_s:g} is shorter than one shot, {last_s:g}"
        )


def plain_burst(burst: Burst | None) -> dict[str, Any] | None:
    """Converts a burst to plain data for JSON."""
    return None if burst is None else {**asdict(burst), "widths_s": list(burst.widths_s)}
