"""Contract of a rig's devices together; the generator's output triggers the camera."""

from __future__ import annotations

import numpy as np

from cldit.rig.errors import DeviceTimeout, MissingFrames
from cldit.rig.load import Rig
from cldit.rig.protocols import Burst, TriggerInfo, TriggerMode
from cldit.testing.expect import Allowed, Check, expect, near, refuses
from tests.patience import HANG_s


def trigger_reaches_the_camera(rig: Rig, allowed: Allowed) -> None:
    """Checks that a burst of three gives three frames, a period apart."""
    burst = rig.trigger.configure(Burst(n=3, period_s=0.5, camera_delay_s=1e-3))
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=3))
    rig.camera.arm()
    rig.trigger.fire()
    refuses(lambda: rig.trigger.wait_done(0.01), DeviceTimeout, "wait_done() within the burst")
    rig.trigger.wait_done(HANG_s)
    frames = list(rig.camera.read_frames(3, HANG_s))
    for gap_ns in np.diff([frame.device_timestamp_ns for frame in frames]):
        near(1e-9 * gap_ns, burst.period_s, 1e-4, "from frame to frame [s]")


def abort_stops_a_burst(rig: Rig, allowed: Allowed) -> None:
    """Checks that abort() prevents the rest of the pulses."""
    many = 500  # a burst of 50 s, which a busy machine aborts in time too
    rig.trigger.configure(Burst(n=many, period_s=0.1))
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=many))
    rig.camera.arm()
    rig.trigger.fire()
    rig.clock.sleep(0.25)
    rig.trigger.abort()
    taken = len(list(rig.camera.read_frames(1, HANG_s))) + rig.camera.flush()
    rig.clock.sleep(0.5)
    late = rig.camera.flush()
    expect(taken < many and late <= 1, f"{taken} frames before abort(), {late} after it")
    rig.trigger.wait_done(0.01)


def one_trigger_starts_several_frames(rig: Rig, allowed: Allowed) -> None:
    """Checks that one pulse starts five frames at the camera's own rate, with continuous ids."""
    rig.trigger.configure(Burst(camera_delay_s=1e-3, inject=allowed.inject))
    trigger = TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=5, frames_per_trigger=5)
    rig.camera.prepare(trigger)
    rig.camera.arm()
    rig.trigger.fire()
    frames = list(rig.camera.read_frames(5, HANG_s))
    rig.trigger.wait_done(HANG_s)
    ids = [frame.frame_id for frame in frames]
    expect(np.all(np.diff(ids) == 1), f"ids {ids} are not continuous")
    period_s = rig.camera.capabilities.minimum_period_s
    for gap_ns in np.diff([frame.device_timestamp_ns for frame in frames]):
        near(1e-9 * gap_ns, period_s, 0.02 * period_s, "from frame to frame [s]")
    refuses(lambda: list(rig.camera.read_frames(1, 0.1)), MissingFrames, "one more frame")
    rig.camera.disarm()
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))  # back to one frame for each
    rig.camera.arm()
    rig.clock.sleep(0.1)
    rig.trigger.fire()
    expect(len(list(rig.camera.read_frames(1, HANG_s))) == 1, "one frame was requested")


TOGETHER = [
    Check("trigger reaches the camera", "pulses the camera", trigger_reaches_the_camera),
    Check("abort", "pulses the camera", abort_stops_a_burst),
    Check("several frames", "pulses the camera", one_trigger_starts_several_frames),
]
