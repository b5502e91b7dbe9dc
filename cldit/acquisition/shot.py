"""One shot: arm, journal, fire once, read, judge."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.interrupts import Interrupts
from cldit.acquisition.journal import Journal
from cldit.acquisition.plan import Plan, Shot
from cldit.acquisition.preflight import Ready
from cldit.acquisition.quality import References, frame_problem, saturated_percent
from cldit.io.images import checksum
from cldit.rig.checks import read_temperature
from cldit.rig.errors import Aborted, FireUncertain, MissingFrames, RigError
from cldit.rig.load import Rig
from cldit.rig.protocols import Burst, Frame

When = Literal["before", "after"]


@dataclass(frozen=True)
class SavedShot:
    """A shot that may be kept, and is on the disk once the sequence yields it: raw counts (h, w),
    or (n, h, w) if the plan has n frames, and its metadata."""

    shot: Shot
    image: NDArray[np.uint16]
    meta: dict[str, Any]


@dataclass(frozen=True)
class Rejected:
    """A shot that must be taken again, with the reason. `fired`: the trigger had been sent.
    `misplaced`: another filter was in front of the camera."""

    reason: str
    fired: bool
    drifted: bool = False
    misplaced: bool = False


class Shooter:
    """Takes shots; remembers the last frame id, so that a gap is noticed."""

    def __init__(
        self,
        rig: Rig,
        plan: Plan,
        ready: Ready,
        journal: Journal,
        interrupts: Interrupts,
        references: References,
    ) -> None:
        self._rig = rig
        self._plan = plan
        self._ready = ready
        self._journal = journal
        self._interrupts = interrupts
        self._references = references
        self._plan_hash = plan.hash()
        self._last_id: int | None = None
        self._next_s = -math.inf  # before this the camera does not take a trigger

    def take(self, shot: Shot, attempt: int) -> SavedShot | Rejected:
        """Makes attempt number `attempt` to take `shot`.

        The `fired` line is on the disk before the trigger goes out. The trigger goes out once:
        whatever fire() says, only a frame that is proven missing is a reason to fire again. Raises
        FireUncertain if the generator does not know whether it fired and no frame came, and Aborted
        by the operator.
        """
        camera, clock = self._rig.camera, self._rig.clock
        flushed = camera.flush()
        expected_id = None if self._last_id is None else self._last_id + flushed + 1
        before_K = read_temperature(self._rig.background)
        changed = self._drifted(shot, before_K, "before") or self._misplaced(shot, "before")
        if changed is not None:
            return changed
        burst = self._rig.trigger.configure(self._plan.burst(shot))
        camera.arm()
        clock.sleep(max(self._next_s - clock.now_s(), 0.0))
        self._journal.append(
            "fired", time=clock.wall_time(), shot=shot.id, attempt=attempt, inject=burst.inject
        )
        try:
            frames, uncertain = self._fired()
        except MissingFrames as error:
            return Rejected(f"missing frame: {error}", fired=True)
        self._last_id = frames[-1].frame_id
        after_K = read_temperature(self._rig.background)
        if (changed := self._misplaced(shot, "after")) is not None:
            return changed
        problem = frame_problem(frames, self._ready, expected_id=expected_id)
        if problem is not None:
            return Rejected(problem, fired=True)
        if (changed := self._drifted(shot, after_K, "after")) is not None:
            return changed
        image = frames[0].data if len(frames) == 1 else np.stack([frame.data for frame in frames])
        problem = self._references.problem(shot, image)
        if problem is not None:
            return Rejected(problem, fired=True)
        readings_K = {"background_before_K": before_K, "background_after_K": after_K}
        meta = {
            **self._of_shot(shot, attempt, burst, readings_K),
            **self._of_frames(frames, image),
            "fire_uncertain": uncertain,
            "plan_hash": self._plan_hash,
            "sha256": checksum(image),
        }
        return SavedShot(shot, image, meta)

    def _of_shot(
        self, shot: Shot, attempt: int, burst: Burst, readings_K: dict[str, float]
    ) -> dict[str, Any]:
        """Metadata of the shot."""
        name = self._plan.filter_name(shot)
        return {
            "shot": shot.id,
            "kind": shot.kind,
            "attempt": attempt,
            "camera_delay_s": burst.camera_delay_s,
            **({} if name is None else {"filter": name}),
            "background": shot.background,
            "background_setpoint_K": shot.background_K,
            **readings_K,
            "time": self._rig.clock.wall_time(),
        }

    def _of_frames(self, frames: list[Frame], image: NDArray[np.uint16]) -> dict[str, Any]:
        """Metadata of the images."""
        times_ns = [int(frame.device_timestamp_ns) for frame in frames]  # int of numpy, too
        return {
            "frame_id": int(frames[0].frame_id),
            "device_timestamp_ns": times_ns[0],
            "host_timestamp_ns": int(frames[0].host_timestamp_ns),
            **({"frame_timestamps_ns": times_ns} if len(frames) > 1 else {}),
            "integration_time_s": self._ready.integration_time_s,
            "saturation_counts": self._ready.saturation_counts,
            "saturated_percent": saturated_percent(image, self._ready.saturation_counts),
        }

    def _drifted(self, shot: Shot, reading_K: float, when: When) -> Rejected | None:
        """Rejection of a shot whose black body is not at its set point."""
        if abs(reading_K - shot.background_K) <= self._plan.drift_K:
            return None
        reason = f"drift: {reading_K:.2f} K {when} the shot"
        return Rejected(reason, fired=when == "after", drifted=True)

    def _misplaced(self, shot: Shot, when: When) -> Rejected | None:
        """Rejection of a shot through another filter than planned, which the wheel is asked for."""
        planned, wheel = self._plan.filter_name(shot), self._rig.filter_wheel
        if planned is None or wheel is None:  # the preflight allows neither without the other
            return None
        if (present := wheel.read_filter()) == planned:
            return None
        reason = f"filter: {present or 'none'} in place of {planned} {when} the shot"
        return Rejected(reason, fired=when == "after", misplaced=True)

    def _fired(self) -> tuple[list[Frame], bool]:
        """Fires once and reads the frames; True if the generator does not know whether it fired."""
        camera, trigger = self._rig.camera, self._rig.trigger
        self._last_id = None  # until a frame says so
        uncertain: FireUncertain | None = None
        try:
            with self._interrupts.abortable():
                try:
                    trigger.fire()
                    busy_s = 1.05 * self._plan.frames * self._ready.minimum_period_s
                    self._next_s = self._rig.clock.now_s() + busy_s
                    trigger.wait_done(self._plan.frame_timeout_s)
                except FireUncertain as error:
                    uncertain = error
                frames = self._read()
        except MissingFrames as error:
            if uncertain is not None:
                _then(uncertain, camera.disarm)
                raise uncertain from error
            camera.disarm()
            raise
        except Aborted as error:
            _then(error, trigger.abort, camera.disarm)
            raise
        except BaseException as error:
            _then(error, camera.disarm)
            raise
        camera.disarm()
        return frames, uncertain is not None

    def _read(self) -> list[Frame]:
        expected = self._plan.frames
        frames = list(self._rig.camera.read_frames(expected, self._plan.frame_timeout_s))
        complete = [frame for frame in frames if frame.complete]
        if len(complete) != expected:
            raise MissingFrames(expected, len(complete), incomplete=len(frames) - len(complete))
        return complete


def _then(error: BaseException, *actions: Callable[[], None]) -> None:
    """Performs actions while `error` is being raised; their own failures become notes of it,
    because the rig is made safe and checked next.
    """
    for action in actions:
        try:
            action()
        except RigError as failed:
            error.add_note(f"then: {failed}")
