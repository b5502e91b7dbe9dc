"""Contract of cameras, and a session with one."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.rig.checks import ROUNDING
from cldit.rig.errors import ConfigRejected, MissingFrames, OutOfLimits
from cldit.rig.protocols import Camera, Frame, TriggerInfo, TriggerMode
from cldit.testing.bed import Step
from cldit.testing.expect import Allowed, Check, HANG_s, expect, near, refuses

_INTEGRATION_s, _AGREE_s = 25e-6, 1e-8
_WALL_s = (-0.1, HANG_s)  # host time of a frame after the start, on a busy machine too


def _take(camera: Camera, n: int) -> list[Frame]:
    camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=n))
    camera.arm()
    for _ in range(n):
        camera.software_trigger()
    frames = list(camera.read_frames(n, HANG_s))
    camera.disarm()
    return frames


def _missing(camera: Camera, n: int, timeout_s: float, arrived: int, call: str) -> None:
    error = refuses(lambda: list(camera.read_frames(n, timeout_s)), MissingFrames, call)
    assert isinstance(error, MissingFrames)
    got = (error.expected, error.received)
    expect(got == (n, arrived), f"{call}: says {got[1]} of {got[0]}, expected {arrived} of {n}")


def frames(camera: Camera, allowed: Allowed) -> None:
    """Checks shape, type, ids, times and noise of images over two starts."""
    camera.wait_ready(HANG_s)
    columns, rows = camera.capabilities.sensor_pixels
    x, y, width, height = camera.read_configuration()["roi"]
    inside = 0 <= x < x + width <= columns and 0 <= y < y + height <= rows
    expect(inside, f"roi {x, y, width, height} is not on the sensor, {columns} x {rows}")
    started_ns = time.time_ns()
    got = _take(camera, 3) + _take(camera, 2)
    for frame in got:
        expect(frame.data.shape == (height, width), f"shape {frame.data.shape} of a frame")
        expect(frame.data.dtype == np.uint16, f"type {frame.data.dtype} of a frame")
        expect(frame.complete, f"frame {frame.frame_id} is incomplete")
        saturation = camera.capabilities.saturation_counts
        expect(
            frame.data.max() <= saturation,
            f"{frame.data.max()} counts, above saturation at {saturation}",
        )
    ids = [frame.frame_id for frame in got]
    expect(ids == list(range(ids[0], ids[0] + 5)), f"ids {ids} are not continuous")
    least_ns = 1e9 * 0.99 * camera.capabilities.minimum_period_s
    for clock in ("device", "host"):
        steps_ns = np.diff([getattr(frame, f"{clock}_timestamp_ns") for frame in got])
        expect(np.all(steps_ns >= least_ns), f"{clock}: {steps_ns} ns from frame to frame")
    if not camera.identify().simulated:
        since_s = [1e-9 * (frame.host_timestamp_ns - started_ns) for frame in got]
        expect(all(_WALL_s[0] < s < _WALL_s[1] for s in since_s), f"host times {since_s} s")
    expect(len({frame.data.tobytes() for frame in got}) == 5, "two frames have the same noise")


def configuration_is_read_back(camera: Camera, allowed: Allowed) -> None:
    """Checks that settings are read back, and that rejected ones change nothing."""
    low, high = camera.capabilities.integration_time_limits_s
    stored = camera.read_configuration()
    for exposure_s in (low, min(max(_INTEGRATION_s, low), high), high):
        settings = camera.configure(exposure_s)
        near(
            settings.integration_time_s, exposure_s, ROUNDING * exposure_s, "integration_time_s [s]"
        )
        stored = camera.read_configuration()
        same = stored["integration_time_s"] == settings.integration_time_s
        expect(same, "configure() and read_configuration() give two integration times")
        saturation = stored["calibration"]["saturation_counts"]
        expect(
            saturation == camera.capabilities.saturation_counts, f"saturation_counts {saturation}"
        )
    for outside in (0.5 * low, 2.0 * high, 0.0, -1.0, math.nan):
        call = f"configure({outside:g})"
        refuses(partial(camera.configure, outside), OutOfLimits, call, "integration_time_s")
    expect(camera.read_configuration() == stored, "a rejected exposure changed the configuration")
    wrong = "Mono1"
    refuses(
        lambda: camera.configure(low, pixel_format=wrong), ConfigRejected, wrong, "pixel_format"
    )


def misses_are_errors(camera: Camera, allowed: Allowed) -> None:
    """Checks that missing frames raise MissingFrames with their number."""
    refuses(camera.software_trigger, ConfigRejected, "software_trigger() before prepare()")
    camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))
    camera.arm()
    _missing(camera, 1, 0.2, 0, "read_frames() without an edge")
    short_s = camera.capabilities.integration_time_limits_s[0]
    refuses(lambda: camera.configure(short_s), ConfigRejected, "configure() of an armed camera")
    camera.disarm()
    camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=2))
    camera.arm()
    camera.software_trigger()
    _missing(camera, 2, 0.2, 1, "two frames after one trigger")


def stops_and_flushes(camera: Camera, allowed: Allowed) -> None:
    """Checks that it stops by itself after n frames, and that `flush` counts discarded frames."""
    camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=2))
    camera.arm()
    initial = camera.statistics()
    for _ in range(3):
        camera.software_trigger()
    flushed, flushed_again = camera.flush(), camera.flush()
    expect(
        (flushed, flushed_again) == (2, 0),
        f"flush() gives {flushed}, then {flushed_again}; expected 2, then 0",
    )
    final = camera.statistics()
    for name, number in (("missed", 1), ("flushed", 2)):
        change = final[name] - initial[name]
        expect(change == number, f"statistics: {name} {change}, expected {number}")
    refuses(lambda: list(camera.read_frames(1, 0.1)), MissingFrames, "a frame after flush()")


def internal_trigger(camera: Camera, allowed: Allowed) -> None:
    """Checks that it runs freely for n frames, if it supports that."""
    if TriggerMode.INTERNAL not in camera.capabilities.trigger_modes:
        return
    camera.prepare(TriggerInfo(TriggerMode.INTERNAL, n_frames=4))
    camera.arm()
    expect(len(list(camera.read_frames(4, HANG_s))) == 4, "four frames were requested")


def refuses_what_it_lacks(camera: Camera, allowed: Allowed) -> None:
    """Checks that unsupported modes and a number of 0 frames are rejected."""
    for mode in sorted(set(TriggerMode) - camera.capabilities.trigger_modes):
        call = f"prepare({mode})"
        refuses(partial(camera.prepare, TriggerInfo(mode)), ConfigRejected, call)
    none = TriggerInfo(TriggerMode.SOFTWARE, n_frames=0)
    refuses(lambda: camera.prepare(none), ConfigRejected, "prepare() for no frames")


CAMERA = [
    Check("frames", "takes five images by software trigger", frames),
    Check("read-back", "sets its shortest and longest exposure", configuration_is_read_back),
    Check("misses", "arms it, and waits for an edge that does not arrive", misses_are_errors),
    Check("stops and flushes", "takes two images and discards them", stops_and_flushes),
    Check("internal trigger", "lets it run for four images", internal_trigger),
    Check("refusals", "requests modes that it lacks", refuses_what_it_lacks),
]


def camera_steps(
    device: Camera,
    edge: Callable[[], None],
    picture: Callable[[], NDArray[np.uint16]] | None = None,
) -> list[Step]:
    """Session with a camera and one image, for which `edge` pulses the trigger input; `picture` is
    the last image that the emulator sent."""

    def images() -> list[Any]:
        edge()
        return [frame.data for frame in device.read_frames(1, HANG_s)]

    def seen(received: list[Any]) -> bool:
        return picture is None or np.array_equal(received, [picture()])

    def settings(got: Any) -> bool:
        seconds = got["integration_time_s"] if isinstance(got, dict) else got.integration_time_s
        return bool(abs(seconds - _INTEGRATION_s) < _AGREE_s)

    external = TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=2)
    return [
        Step("ready", lambda: device.wait_ready(HANG_s)),
        Step("configure", lambda: device.configure(_INTEGRATION_s), settings),
        Step("prepare", lambda: device.prepare(external)),
        Step("configuration", device.read_configuration, settings),
        Step("arm", device.arm),
        Step("images", images, seen),
    ]
