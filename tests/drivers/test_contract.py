"""What every camera, background and trigger generator must do, whoever made it.

A driver joins by a rig in `RIGS` (cameras with a trigger line, trigger generators), `CAMERAS` or
`BACKGROUNDS` of `tests/rigs.py`. Those of real instruments talk over loopback sockets and
pseudo-terminals to the peers in `cldit.drivers`, whose time is real but for the black bodies',
which share the rig's simulated clock, and to Aravis' camera.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest

from cldit.rig.errors import (
    ConfigRejected,
    DeviceTimeout,
    MissingFrames,
    NotConnected,
    OutOfLimits,
)
from cldit.rig.load import Rig
from cldit.rig.protocols import (
    Background,
    Burst,
    Camera,
    Device,
    Roi,
    Stability,
    TriggerGenerator,
    TriggerInfo,
    TriggerMode,
)
from tests.rigs import BACKGROUNDS, CAMERAS, RIGS, Make


def opened(make: Make, data: dict[str, Any]) -> Iterator[Rig]:
    with ExitStack() as stack:
        rig = make(data, stack)
        yield rig
        rig.close()


def over_sockets(rigs: dict[str, Make]) -> list[Any]:
    return [
        name if name == "simulated" else pytest.param(name, marks=pytest.mark.loopback_only)
        for name in rigs
    ]


@pytest.fixture(params=over_sockets(RIGS))
def rig(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Rig]:
    """A rig that is not connected yet."""
    yield from opened(RIGS[request.param], tiny_rig)


@pytest.fixture(params=BACKGROUNDS)
def background_rig(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Rig]:
    yield from opened(BACKGROUNDS[request.param], tiny_rig)


@pytest.fixture(params=["camera", "background", "trigger"])
def device(request: pytest.FixtureRequest, rig: Rig) -> Device:
    return rig.devices[request.param]


@pytest.fixture(params=over_sockets(CAMERAS))
def camera(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Camera]:
    for rig in opened(CAMERAS[request.param], tiny_rig):
        rig.camera.connect()
        if rig.camera.identify().maker == "Aravis":  # slow, and black at short exposures
            rig.camera.configure(5e-3, Roi(0, 0, 640, 512))
        yield rig.camera


@pytest.fixture
def background(background_rig: Rig) -> Background:
    background_rig.background.connect()
    return background_rig.background


@pytest.fixture
def trigger(rig: Rig) -> TriggerGenerator:
    rig.connect()
    return rig.trigger


# Every device


def test_life(device: Device) -> None:
    """Connect, make safe and close may each be called twice; before, it says what is wrong."""
    device.make_safe()
    device.close()
    with pytest.raises(NotConnected, match="connect"):
        device.read_configuration()
    device.connect()
    device.connect()
    assert json.loads(json.dumps(device.read_configuration(), allow_nan=False))
    device.make_safe()
    device.make_safe()
    device.close()
    device.close()
    with pytest.raises(NotConnected):
        device.read_configuration()
    device.connect()
    assert device.read_configuration()


def test_identity(device: Device) -> None:
    info = device.identify()
    assert info.kind in ("camera", "background", "trigger")
    assert info.maker and info.model and isinstance(info.simulated, bool)


# Cameras


def take(camera: Camera, n: int = 1) -> list[Any]:
    camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=n))
    camera.arm()
    for _ in range(n):
        camera.software_trigger()
    frames = list(camera.read_frames(n, 5.0))
    camera.disarm()
    return frames


def test_camera_frames(camera: Camera) -> None:
    camera.wait_ready(60.0)
    columns, rows = camera.capabilities.sensor_pixels
    x, y, width, height = camera.read_configuration()["roi"]
    assert 0 <= x < x + width <= columns and 0 <= y < y + height <= rows
    started_ns = time.time_ns()
    frames = take(camera, 3) + take(camera, 2)
    for frame in frames:
        assert frame.data.shape == (height, width) and frame.data.dtype == np.uint16
        assert frame.complete and frame.data.max() <= camera.capabilities.saturation_counts
    ids = [frame.frame_id for frame in frames]
    assert ids == list(range(ids[0], ids[0] + 5))
    # Aravis' camera looks for a trigger every 0.1 s, and no one can ask what time it has: the
    # host's is that of reading.
    slow = camera.identify().maker == "Aravis"
    least_ns = 1e9 * (0.99 * camera.capabilities.minimum_period_s - (0.1 if slow else 0.0))
    assert np.all(np.diff([frame.device_timestamp_ns for frame in frames]) >= least_ns)
    on_host = np.diff([frame.host_timestamp_ns for frame in frames])
    assert np.all(on_host >= (0.0 if slow else least_ns))
    if camera.identify().simulated is False:  # wall time, to what a busy machine may take
        assert all(-1e8 < frame.host_timestamp_ns - started_ns < 6e10 for frame in frames)
    assert len({frame.data.tobytes() for frame in frames}) == 5  # noise is not repeated


def test_camera_configuration_is_read_back(camera: Camera) -> None:
    low, high = camera.capabilities.integration_time_limits_s
    for wanted in (low, 25e-6, high):
        settings = camera.configure(wanted)
        assert settings.integration_time_s == pytest.approx(wanted, rel=0.01)
        stored = camera.read_configuration()
        assert stored["integration_time_s"] == settings.integration_time_s
        assert stored["calibration"]["saturation_counts"] == camera.capabilities.saturation_counts
    for outside in (0.5 * low, 2.0 * high, 0.0, -1.0, float("nan")):
        with pytest.raises(OutOfLimits, match="integration_time_s"):
            camera.configure(outside)
    assert camera.read_configuration() == stored  # a refusal changes nothing
    with pytest.raises(ConfigRejected, match="pixel_format"):
        camera.configure(25e-6, pixel_format="Mono1")


def test_camera_misses_are_errors(camera: Camera) -> None:
    with pytest.raises(ConfigRejected):
        camera.software_trigger()
    camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))
    camera.arm()
    with pytest.raises(MissingFrames) as caught:
        list(camera.read_frames(1, 0.2))
    assert (caught.value.expected, caught.value.received) == (1, 0)
    with pytest.raises(ConfigRejected):
        camera.configure(25e-6)  # armed
    camera.disarm()
    camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=2))
    camera.arm()
    camera.software_trigger()
    with pytest.raises(MissingFrames) as caught:
        list(camera.read_frames(2, 0.2))
    assert (caught.value.expected, caught.value.received) == (2, 1)


def test_camera_stops_after_n_frames_and_flushes(camera: Camera) -> None:
    camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=2))
    camera.arm()
    before = camera.statistics()
    for _ in range(3):
        camera.software_trigger()
    assert camera.flush() == 2 and camera.flush() == 0
    after = camera.statistics()
    assert after["missed"] - before["missed"] == 1 and after["flushed"] - before["flushed"] == 2
    with pytest.raises(MissingFrames):
        list(camera.read_frames(1, 0.1))


def test_camera_internal_trigger(camera: Camera) -> None:
    if TriggerMode.INTERNAL not in camera.capabilities.trigger_modes:
        pytest.skip("has no internal trigger")
    camera.prepare(TriggerInfo(TriggerMode.INTERNAL, n_frames=4))
    camera.arm()
    assert len(list(camera.read_frames(4, 5.0))) == 4


def test_camera_refuses_modes_that_it_lacks(camera: Camera) -> None:
    for mode in set(TriggerMode) - camera.capabilities.trigger_modes:
        with pytest.raises(ConfigRejected):
            camera.prepare(TriggerInfo(mode))
    with pytest.raises(ConfigRejected):
        camera.prepare(TriggerInfo(TriggerMode.SOFTWARE, n_frames=0))


# Backgrounds


def test_background_limits(background: Background) -> None:
    limits = background.limits
    before = background.read_configuration()
    for outside in (limits.low_K - 1.0, limits.high_K + 1.0, float("nan"), float("inf")):
        with pytest.raises(OutOfLimits):
            background.set_setpoint(outside)
    assert background.read_configuration() == before
    for inside in (limits.low_K, limits.high_K):
        assert background.set_setpoint(inside) == pytest.approx(inside, abs=0.1)


def test_background_settles(background: Background) -> None:
    rule = Stability(tolerance_K=0.5, hold_s=10.0, settle_s=5.0, timeout_s=3600.0)
    wanted = background.read_temperature() + 20.0
    background.set_setpoint(wanted)
    assert background.is_stable() in (False, None)
    seen: list[float] = []
    got = background.wait_stable(wanted, rule, on_progress=seen.append)
    assert abs(got - wanted) <= 0.5 and background.is_stable() in (True, None)
    assert seen[0] < wanted - 10.0 and all(abs(reading - wanted) <= 0.5 for reading in seen[-15:])
    with pytest.raises(DeviceTimeout):
        background.wait_stable(wanted + 50.0, Stability(0.5, 10.0, 5.0, 20.0))


# Trigger generators


def test_trigger_starts_inhibited(trigger: TriggerGenerator) -> None:
    with pytest.raises(ConfigRejected, match="configure"):
        trigger.fire()
    trigger.configure(Burst())
    trigger.inhibit()
    with pytest.raises(ConfigRejected):
        trigger.fire()
    trigger.configure(Burst())
    trigger.make_safe()
    with pytest.raises(ConfigRejected):
        trigger.fire()


def test_trigger_quantises_a_little(trigger: TriggerGenerator) -> None:
    asked = Burst(
        camera_delay_s=0.95e-3 + 1e-10, injector_delay_s=1e-5, widths_s=(1e-4, 1.5e-3), inject=True
    )
    got = trigger.configure(asked)
    assert got.camera_delay_s == pytest.approx(asked.camera_delay_s, abs=1e-6)
    assert got.n == 1 and got.inject
    assert trigger.configure(got) == got  # what it can do, it does exactly


@pytest.mark.parametrize(
    "burst",
    [
        Burst(n=0),
        Burst(camera_delay_s=-1e-3),
        Burst(widths_s=(0.0, 1e-3)),
        Burst(n=2, period_s=1e-3, camera_delay_s=2e-3),
    ],
)
def test_trigger_refuses(trigger: TriggerGenerator, burst: Burst) -> None:
    with pytest.raises(ConfigRejected):
        trigger.configure(burst)
    with pytest.raises(ConfigRejected):
        trigger.fire()


def test_trigger_reaches_the_camera(rig: Rig) -> None:
    """One burst of three: three frames, a period apart, and the generator is then done."""
    rig.connect()
    burst = rig.trigger.configure(Burst(n=3, period_s=0.05, camera_delay_s=1e-3))
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=3))
    rig.camera.arm()
    rig.trigger.fire()
    with pytest.raises(DeviceTimeout):
        rig.trigger.wait_done(0.01)
    rig.trigger.wait_done(5.0)
    frames = list(rig.camera.read_frames(3, 1.0))
    gaps_s = np.diff([frame.device_timestamp_ns for frame in frames]) * 1e-9
    assert gaps_s == pytest.approx([burst.period_s, burst.period_s], abs=1e-4)


def test_trigger_abort_stops_a_burst(rig: Rig) -> None:
    rig.connect()
    rig.trigger.configure(Burst(n=10, period_s=0.1))
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=10))
    rig.camera.arm()
    rig.trigger.fire()
    rig.clock.sleep(0.25)
    rig.trigger.abort()
    rig.clock.sleep(1.2)
    assert rig.camera.flush() == 3  # at 0, 0.1 and 0.2 s
    rig.trigger.wait_done(0.01)


def test_one_trigger_starts_several_frames(rig: Rig) -> None:
    """A burst at the camera's own rate, continuous in its ids; the generator pulsed once."""
    rig.connect()
    rig.trigger.configure(Burst(camera_delay_s=1e-3, inject=True))
    trigger = TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=5, frames_per_trigger=5)
    rig.camera.prepare(trigger)
    rig.camera.arm()
    rig.trigger.fire()
    frames = list(rig.camera.read_frames(5, 1.0))
    rig.trigger.wait_done(1.0)
    assert np.all(np.diff([frame.frame_id for frame in frames]) == 1)
    gaps_s = np.diff([frame.device_timestamp_ns for frame in frames]) * 1e-9
    assert gaps_s == pytest.approx(np.full(4, rig.camera.capabilities.minimum_period_s), rel=0.02)
    with pytest.raises(MissingFrames):
        list(rig.camera.read_frames(1, 0.1))  # it was one trigger
    rig.camera.disarm()
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))  # and back to one frame each
    rig.camera.arm()
    rig.clock.sleep(0.1)
    rig.trigger.fire()
    assert len(list(rig.camera.read_frames(1, 1.0))) == 1
