"""The sequence of one plan: preflight, then background by background, shot by shot.

```
  folder surveyed, nothing left to do ------------------------------------------> finished
        | shots left
        v
   preflight   all devices, limits, read-back, test picture, room on the disk
        v
   stabilise <--------------------+-----------------+
        | stable                  | next background |
        v                         | or drift        | no background left
  filter, shoot -----------------+                 +--------------------------> finished
        ^  | saved, next shot; or missing frame or wrong filter, retake (bounded)
        +--+

   any state --- Ctrl-C, should_stop (after the shot) ---> stopped
   any state --- error, second Ctrl-C (within the shot) -> raised
   finished, stopped, raised: the rig is made safe
```
"""

import json
import math
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from cldit.acquisition.disk import needed_bytes
from cldit.acquisition.interrupts import Interrupts
from cldit.acquisition.journal import Entry, Journal
from cldit.acquisition.plan import Plan, Shot
from cldit.acquisition.preflight import Ready, preflight
from cldit.acquisition.progress import Approach, Eta, Progress
from cldit.acquisition.quality import References
from cldit.acquisition.shot import Rejected, SavedShot, Shooter
from cldit.acquisition.storage import (
    CONFIGURATION,
    JOURNAL,
    PLAN,
    RIG,
    SHOTS,
    FolderContent,
    load_shot,
    save_shot,
    shot_path,
    survey,
)
from cldit.errors import ClditError
from cldit.io.digests import sha256_of
from cldit.io.files import make_folder, write_text, written
from cldit.io.plain_data import dump_yaml
from cldit.rig.checks import read_temperature
from cldit.rig.errors import Aborted, RetakesExhausted, RigError
from cldit.rig.load import Rig
from cldit.rig.stability import wait_stable

# The curve of an approach, which takes minutes, has a point each 10 s. The other instruments are
# asked as often, because they close sessions that are idle for a minute.
_APPROACH_s = 10.0


@dataclass(frozen=True)
class Record:
    """Result of an acquisition. `lost_injections` entered the vessel without a kept image."""

    folder: Path
    complete: bool
    saved: int
    total: int
    lost_injections: int
    rejected: int


class Sequence:
    """Sequence of the module docstring; `run` can be iterated once."""

    def __init__(
        self,
        rig: Rig,
        plan: Plan,
        folder: Path,
        interrupts: Interrupts,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._rig = rig
        self._plan = plan
        self._folder = folder
        self._interrupts = interrupts
        self._report = progress
        self._steps = plan.steps()
        self._done: set[str] = set()
        self._eta = Eta()
        self._picture_bytes = 0
        self._filter: str | None = None  # to which the wheel was moved last; None: to be moved

    def run(self) -> Generator[SavedShot, None, Record]:
        """Takes the missing shots of the plan, and yields each one after it is saved."""
        content = survey(self._folder, self._plan)
        self._done = content.done
        if content.entries:
            times = [datetime.fromisoformat(entry["time"]) for entry in content.entries]
            self._rig.clock.catch_up(max(times).timestamp() + 1.0)
        missing = len(self._steps) - len(self._done)
        ready: Ready | None = None
        if missing:
            self._say("preflight")
            with self._interrupts.abortable():
                ready = preflight(self._rig, self._plan, self._folder, shots_left=missing)
            self._picture_bytes = ready.picture_bytes
            with written(self._folder, needed_bytes=self._room_bytes()):
                self._prepare_folder(ready)
        with Journal(self._folder / JOURNAL, self._room_bytes) as journal:
            self._reconcile(journal, content)
            if ready is not None:
                yield from self._measure(journal, ready)
            return self._record(journal.entries)

    def _room_bytes(self) -> int:
        missing = len(self._steps) - len(self._done)
        return needed_bytes(missing, picture_bytes=self._picture_bytes)

    def _prepare_folder(self, ready: Ready) -> None:
        """Writes what the images need beside them, and is not there yet."""
        make_folder(self._folder / SHOTS)
        begun = (self._folder / PLAN).exists()
        rig_file = self._rig.file.model_dump(mode="json")
        texts = {
            RIG: dump_yaml(rig_file),
            CONFIGURATION: json.dumps(ready.configuration, indent=2, allow_nan=False),
            PLAN: self._plan.dump(),  # last: with it, the folder belongs to this plan
        }
        for name, content in texts.items():
            if not begun or not (self._folder / name).exists():
                write_text(self._folder / name, content)

    def _reconcile(self, journal: Journal, content: FolderContent) -> None:
        for shot_id in content.torn:
            path = shot_path(self._folder, shot_id)
            path.replace(path.with_name(path.name + ".torn"))
        for meta in content.adoptable.values():
            digest = sha256_of(shot_path(self._folder, meta["shot"]))
            journal.append("saved", **_saved(meta), file_sha256=digest, adopted=True)
        for fired in content.lost:
            self._note_lost(journal, fired, "the acquisition ended between trigger and image")

    def _note_lost(self, journal: Journal, fired: Entry, reason: str) -> None:
        repeated = {name: fired[name] for name in ("shot", "attempt", "inject")}
        journal.append("lost", time=self._rig.clock.wall_time(), **repeated, reason=reason)

    def _measure(self, journal: Journal, ready: Ready) -> Generator[SavedShot, None, None]:
        clock = self._rig.clock
        journal.append(
            "start",
            time=clock.wall_time(),
            configuration=ready.configuration,
            files={name: sha256_of(self._folder / name) for name in (RIG, CONFIGURATION, PLAN)},
        )
        references = References(self._plan, ready)
        shooter = Shooter(self._rig, self._plan, ready, journal, self._interrupts, references)
        missing = [shot for shot in self._steps if shot.id not in self._done]
        order = self._plan.background_order(
            {shot.background for shot in missing}, present_K=read_temperature(self._rig.background)
        )
        self._eta.plan(backgrounds=len(order), shots=len(missing))
        self._rig.camera.prepare(ready.trigger)
        try:
            for background in order:
                self._stabilise(journal, self._plan.backgrounds_K[background])
                for shot in self._steps:
                    kept = shot.background == background and shot.id in self._done
                    if kept and shot.kind == "reference":  # of an earlier run
                        image, _ = load_shot(self._folder, shot.id, plan_hash=self._plan.hash())
                        references.learn(shot, image)
                of_background = [shot for shot in missing if shot.background == background]
                for shot in self._plan.from_filter(of_background, self._filter):
                    saved = self._shoot(journal, shooter, shot)
                    if shot.kind == "reference":
                        references.learn(shot, saved.image)
                    yield saved
                    if self._interrupts.should_stop():
                        raise _Stopped
        except _Stopped:
            journal.append("stopped", time=clock.wall_time())
            return
        except GeneratorExit:
            journal.append("stopped", time=clock.wall_time())
            raise
        journal.append("finished", time=clock.wall_time())

    def _stabilise(self, journal: Journal, temperature_K: float) -> None:
        clock, background = self._rig.clock, self._rig.background
        if self._interrupts.should_stop():
            raise _Stopped
        start = clock.now_s()
        got = background.set_setpoint(temperature_K)
        if not abs(got - temperature_K) <= self._plan.stability.tolerance_K:
            raise RigError(
                f"background: set point reads back {got:g} K after {temperature_K:g} K was written"
            )
        noted_s = -math.inf

        def approaches(now_K: float) -> None:
            nonlocal noted_s
            if clock.now_s() - noted_s >= _APPROACH_s:
                noted_s = clock.now_s()
                self._note_approach(journal, now_K, temperature_K)
            approach = Approach(
                reading_K=now_K,
                setpoint_K=temperature_K,
                tolerance_K=self._plan.stability.tolerance_K,
            )
            self._say(f"background {now_K:.1f} K, to {temperature_K:g} K", approach)

        try:
            reading = wait_stable(
                background,
                clock,
                temperature_K,
                self._plan.stability,
                should_stop=self._interrupts.should_stop,
                on_progress=approaches,
            )
        except Aborted as error:
            raise _Stopped from error
        elapsed_s = clock.now_s() - start
        self._eta.add("background", elapsed_s)
        journal.append(
            "stable",
            time=clock.wall_time(),
            background_K=temperature_K,
            reading_K=reading,
            elapsed_s=elapsed_s,
        )

    def _note_approach(self, journal: Journal, reading_K: float, setpoint_K: float) -> None:
        journal.append(
            "approaching",
            time=self._rig.clock.wall_time(),
            sync=False,  # a power cut may take the curve's last points
            background_K=setpoint_K,
            reading_K=reading_K,
        )
        for name, device in self._rig.devices.items():
            if name != "background":  # which is read all the time
                device.read_configuration()

    def _choose_filter(self, journal: Journal, shot: Shot) -> None:
        """Moves the filter wheel, if any, to the filter of a shot."""
        name, wheel = self._plan.filter_name(shot), self._rig.filter_wheel
        if name is None or wheel is None or name == self._filter:
            return
        self._say(f"filter wheel to {name}")
        clock, self._filter = self._rig.clock, None
        start_s = clock.now_s()
        with self._interrupts.abortable():
            wheel.move(name)
        elapsed_s = clock.now_s() - start_s
        journal.append("filter", time=clock.wall_time(), filter=name, elapsed_s=elapsed_s)
        self._filter = name

    def _shoot(self, journal: Journal, shooter: Shooter, shot: Shot) -> SavedShot:
        clock = self._rig.clock
        next_attempt = 1 + max(
            (entry["attempt"] for entry in journal.entries if entry.get("shot") == shot.id),
            default=-1,
        )
        start = clock.now_s()
        reason = ""
        for attempt in range(next_attempt, next_attempt + self._plan.retakes + 1):
            self._choose_filter(journal, shot)
            self._say(self._plan.describe(shot))
            if not clock.sleep(self._plan.pause_s, self._interrupts.should_stop):
                raise _Stopped
            try:
                result = shooter.take(shot, attempt)
            except Exception as error:
                self._lose(journal, shot, attempt, error)
                raise
            if isinstance(result, SavedShot):
                self._save(journal, result)
                self._eta.add("shot", clock.now_s() - start)
                self._say(self._plan.describe(shot))
                return result
            reason = result.reason
            self._reject(journal, shot, attempt, result)
        raise RetakesExhausted(
            f"{shot.id}: rejected {self._plan.retakes + 1} times, at last for {reason}; "
            "mend it and give the same command again, it resumes"
        )

    def _save(self, journal: Journal, taken: SavedShot) -> None:
        shot, pixel_m = taken.shot, self._rig.file.setup.pixel_m
        with written(shot_path(self._folder, shot.id), needed_bytes=self._room_bytes()):
            digest = save_shot(self._folder, shot, taken.image, pixel_m=pixel_m, meta=taken.meta)
        # The image is on the disk; were this line lost, the next run would find it and adopt it.
        # The next `fired` line, which is always synced, takes it along.
        journal.append("saved", **_saved(taken.meta), file_sha256=digest, sync=False)
        self._done.add(shot.id)

    def _reject(self, journal: Journal, shot: Shot, attempt: int, result: Rejected) -> None:
        journal.append(
            "rejected",
            time=self._rig.clock.wall_time(),
            shot=shot.id,
            attempt=attempt,
            inject=result.fired and shot.kind == "injection",
            reason=result.reason,
        )
        if self._interrupts.should_stop():
            raise _Stopped
        if result.misplaced:
            self._filter = None
        if result.drifted:
            self._stabilise(journal, shot.background_K)

    def _lose(self, journal: Journal, shot: Shot, attempt: int, error: Exception) -> None:
        """Notes the error of a shot that may have been fired and has no image."""
        newest = journal.entries[-1]
        if newest["event"] == "fired" and (newest["shot"], newest["attempt"]) == (shot.id, attempt):
            with suppress(ClditError):  # the `fired` line says it too, and the next resume notes it
                self._note_lost(journal, newest, str(error))

    def _record(self, entries: list[Entry]) -> Record:
        wasted = [entry for entry in entries if entry["event"] in ("lost", "rejected")]
        return Record(
            folder=self._folder,
            complete=len(self._done) == len(self._steps),
            saved=len(self._done),
            total=len(self._steps),
            lost_injections=sum(bool(entry["inject"]) for entry in wasted),
            rejected=sum(entry["event"] == "rejected" for entry in entries),
        )

    def _say(self, phase: str, approach: Approach | None = None) -> None:
        if self._report is not None:
            done, total = len(self._done), len(self._steps)
            self._report(Progress(phase, done, total, self._eta.left_s(), approach))


class _Stopped(Exception):
    """Raised to stop before anything new is begun."""


def _saved(meta: dict[str, Any]) -> dict[str, Any]:
    """The part of an image's metadata that the journal repeats."""
    names = (
        "time",
        "shot",
        "attempt",
        "background_before_K",
        "background_after_K",
        "saturated_percent",
        "sha256",
    )
    return {name: meta[name] for name in (*names, *({"filter"} & set(meta)))}
