"""One shot: arm, journal, fire once, read, judge."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
from cldit.rig.protocols import Frame


@dataclass(frozen=True)
class Taken:
    """An image (h, w), or a shot's (n, h, w), that may be kept, with its metadata."""

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

    def take(self, shot: Shot, attempt: int) -> Taken | Rejected:
        """Makes attempt number `attempt` to take `shot`.

        The `fired` line is on the disk before the trigger goes out. The trigger goes out once:
        whatever fire() says, only a frame that is proven missing is a reason to fire again. Raises
        FireUncertain if the generator does not know whether it fired and no frame came, and Aborted
        by the operator.
        """
        camera, background, trigger = self._rig.camera, self._rig.background, self._rig.trigger
        flushed = camera.flush()
        expected_id = None if self._last_id is None else self._last_id + flushed + 1
        before_K = read_temperature(background)
        if not abs(before_K - shot.background_K) <= self._plan.drift_K:
            return Rejected(f"drift: {before_K:.2f} K before the shot", fired=False, drifted=True)
        if (wrong := self._wrong_filter(shot)) is not None:
            return Rejected(f"filter: {wrong} before the shot", fired=False, misplaced=True)
        burst = trigger.configure(self._plan.burst(shot))
        camera.arm()
        clock = self._rig.clock
        clock.sleep(max(self._next_s - clock.now_s(), 0.0))
        self._journal.append(
            "fired", time=clock.wall_time(), shot=shot.id, attempt=attempt, inject=burst.inject
        )
        try:
            frames, uncertain = self._fired()
        except MissingFrames as error:
            return Rejected(f"missing frame: {error}", fired=True)
        self._last_id = frames[-1].frame_id
        after_K = read_temperature(background)
        if (wrong := self._wrong_filter(shot)) is not None:
            return Rejected(f"filter: {wrong} after the shot", fired=True, misplaced=True)
        problem = frame_problem(frames, self._ready, expected_id=expected_id)
        if problem is not None:
            return Rejected(problem, fired=True)
        if not abs(after_K - shot.background_K) <= self._plan.drift_K:
            return Rejected(f"drift: {after_K:.2f} K after the shot", fired=True, drifted=True)
        start_frame = frames[0]
        image = start_frame.data if len(frames) == 1 else np.stack([frame.data for frame in frames])
        problem = self._references.problem(shot, image)
        if problem is not None:
            return Rejected(problem, fired=True)
        several = [frame.device_timestamp_ns for frame in frames]
        return Taken(
            image,
            {
                "shot": shot.id,
                "kind": shot.kind,
                "attempt": attempt,
                "camera_delay_s": burst.camera_delay_s,
                **({} if (name := self._plan.filter_name(shot)) is None else {"filter": name}),
                "background": shot.background,
                "background_setpoint_K": shot.background_K,
                "background_before_K": before_K,
                "background_after_K": after_K,
                "time": clock.wall_time(),
                "frame_id": start_frame.frame_id,
                "device_timestamp_ns": start_frame.device_timestamp_ns,
                "host_timestamp_ns": start_frame.host_timestamp_ns,
                **({"frame_timestamps_ns": several} if len(several) > 1 else {}),
                "integration_time_s": self._ready.integration_time_s,
                "saturation_counts": self._ready.saturation_counts,
                "saturated_percent": saturated_percent(image, self._ready.saturation_counts),
                "fire_uncertain": uncertain,
                "plan_hash": self._plan_hash,
                "sha256": checksum(image),
            },
        )

    def _wrong_filter(self, shot: Shot) -> str | None:
        """Reads the filter wheel, and describes the filter if it is not the one of the shot."""
        planned, wheel = self._plan.filter_name(shot), self._rig.filter_wheel
        if planned is None or wheel is None:  # the preflight allows neither without the other
            return None
        present = wheel.read_filter()
        return None if present == planned else f"{present or 'none'} in place of {planned}"

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
