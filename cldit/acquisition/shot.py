"""One shot: arm, journal, fire once, read, judge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.interrupts import Interrupts
from cldit.acquisition.journal import Journal
from cldit.acquisition.plan import Plan, Shot
from cldit.acquisition.preflight import Ready
from cldit.acquisition.storage import checksum
from cldit.rig.errors import Aborted, FireUncertain, MissingFrames
from cldit.rig.load import Rig
from cldit.rig.protocols import Frame


@dataclass(frozen=True)
class Taken:
    """A picture that may be kept, and what is stored beside it."""

    image: NDArray[np.uint16]
    meta: dict[str, Any]


@dataclass(frozen=True)
class Rejected:
    """A shot that must be taken again, and why. `fired`: the trigger had been sent."""

    reason: str
    fired: bool
    drifted: bool = False


class Shooter:
    """Takes shots; remembers the last frame id, so that a gap is noticed."""

    def __init__(
        self, rig: Rig, plan: Plan, ready: Ready, journal: Journal, interrupts: Interrupts
    ) -> None:
        self._rig = rig
        self._plan = plan
        self._ready = ready
        self._journal = journal
        self._interrupts = interrupts
        self._plan_hash = plan.hash()
        self._last_id: int | None = None
        self._next_s = -math.inf  # before this the camera does not take a trigger

    def take(self, shot: Shot, attempt: int) -> Taken | Rejected:
        """One attempt. The `fired` line is on the disk before the trigger goes out, and the
        trigger goes out once: whatever fire() says, only a frame that is proven missing is a
        reason to fire again.

        Raises:
            FireUncertain: the generator does not know whether it fired, and no frame came.
            Aborted: by the operator.
        """
        camera, background, trigger = self._rig.camera, self._rig.background, self._rig.trigger
        flushed = camera.flush()
        expected_id = None if self._last_id is None else self._last_id + flushed + 1
        before_K = background.read_temperature()
        if not abs(before_K - shot.background_K) <= self._plan.drift_K:
            return Rejected(f"drift: {before_K:.2f} K before the shot", fired=False, drifted=True)
        burst = trigger.configure(self._plan.burst(shot))
        camera.arm()
        clock = self._rig.clock
        clock.sleep(max(self._next_s - clock.now_s(), 0.0))
        self._journal.append(
            "fired",
            time=self._rig.clock.wall_time(),
            shot=shot.id,
            attempt=attempt,
            inject=burst.inject,
        )
        self._last_id = None  # until a frame says so
        uncertain: FireUncertain | None = None
        try:
            with self._interrupts.abortable():
                try:
                    trigger.fire()
                    self._next_s = clock.now_s() + 1.05 * self._ready.minimum_period_s
                    trigger.wait_done(self._plan.frame_timeout_s)
                except FireUncertain as error:
                    uncertain = error
                frame = self._read()
        except MissingFrames as error:
            if uncertain is not None:
                raise uncertain from error
            return Rejected(f"missing frame: {error}", fired=True)
        except Aborted:
            trigger.abort()
            raise
        finally:
            camera.disarm()
        self._last_id = frame.frame_id
        after_K = background.read_temperature()
        problem = self._problem(frame, expected_id)
        if problem is not None:
            return Rejected(problem, fired=True)
        if not abs(after_K - shot.background_K) <= self._plan.drift_K:
            return Rejected(f"drift: {after_K:.2f} K after the shot", fired=True, drifted=True)
        saturated = np.count_nonzero(frame.data >= self._ready.saturation_counts)
        return Taken(
            frame.data,
            {
                "shot": shot.id,
                "kind": shot.kind,
                "attempt": attempt,
                "background": shot.background,
                "background_setpoint_K": shot.background_K,
                "background_before_K": before_K,
                "background_after_K": after_K,
                "time": self._rig.clock.wall_time(),
                "frame_id": frame.frame_id,
                "device_timestamp_ns": frame.device_timestamp_ns,
                "host_timestamp_ns": frame.host_timestamp_ns,
                "integration_time_s": self._ready.integration_time_s,
                "saturation_counts": self._ready.saturation_counts,
                "saturated_percent": 100.0 * saturated / frame.data.size,
                "fire_uncertain": uncertain is not None,
                "plan_hash": self._plan_hash,
                "sha256": checksum(frame.data),
            },
        )

    def _read(self) -> Frame:
        frames = list(self._rig.camera.read_frames(1, self._plan.frame_timeout_s))
        whole = [frame for frame in frames if frame.complete]
        if len(whole) != 1:
            raise MissingFrames(1, len(whole), incomplete=len(frames) - len(whole))
        return whole[0]

    def _problem(self, frame: Frame, expected_id: int | None) -> str | None:
        if expected_id is not None and frame.frame_id != expected_id:
            return f"missing frame: frame {frame.frame_id} came in place of {expected_id}"
        if frame.data.shape != self._ready.shape or frame.data.dtype != np.uint16:
            return (
                f"damaged frame: {frame.data.dtype} of shape {frame.data.shape}, expected uint16 "
                f"of {self._ready.shape}"
            )
        if frame.data.min() == frame.data.max() < self._ready.saturation_counts:
            return f"dead frame: every pixel shows {frame.data.min()}"
        return None
