"""State of a recording, read from its folder by another process.

Nothing here writes, locks or asks the recording: it reads the plan once, and of the journal only
new lines. It can neither stop nor delay a shot.
"""

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from cldit.acquisition.journal import Entry, parse_entry
from cldit.acquisition.plan import Plan, Shot, load_plan
from cldit.acquisition.progress import Eta
from cldit.acquisition.storage import JOURNAL, PLAN
from cldit.errors import RunFolderError
from cldit.io.files import open_regular

State = Literal["preparing", "approaching", "recording", "finished", "stopped", "broken off"]


@dataclass(frozen=True)
class Reading:
    """The black body at a time of the rig, in seconds since this session began."""

    time_s: float
    reading_K: float
    setpoint_K: float


@dataclass(frozen=True, kw_only=True)
class Seen:
    """State of a recording. left_s: in the rig's time, None while unknown. readings: of this
    session. last: `saved` line of the newest shot. alarms: possible dangers, a line each.
    """

    state: State
    plan: Plan | None = None
    doing: str = ""
    done: int = 0
    total: int = 0
    left_s: float | None = None
    rejected: int = 0
    lost: int = 0
    readings: tuple[Reading, ...] = ()
    last: Entry | None = None
    alarms: tuple[str, ...] = ()


class Watch:
    """Reads the new lines of a journal on request.

    `folder` need not exist yet. `known_bytes` is the length of the journal when the recording
    began: lines before it belong to earlier sessions.
    """

    def __init__(self, folder: Path, *, known_bytes: int = 0) -> None:
        self._folder = folder
        self._known_bytes = known_bytes
        self._at = 0
        self._lines = 0
        self._seen = Seen(state="preparing")
        self._shots: dict[str, Shot] = {}
        self._saved: set[str] = set()
        self._eta = Eta()
        self._event = ""
        self._begin_s: float | None = None
        self._before_s = 0.0

    def look(self) -> bool:
        """Reads new lines; True if there were any. Raises FileError if journal or plan cannot be
        read, RunFolderError if the journal is damaged.
        """
        plan = self._seen.plan
        if plan is None:
            if not (self._folder / PLAN).exists():
                return False
            plan = load_plan(self._folder / PLAN)
            self._shots = {shot.id: shot for shot in plan.steps()}
            self._note(plan=plan)
        path = self._folder / JOURNAL
        if not path.exists():
            return False
        with open_regular(path) as stream:
            stream.seek(self._at)
            data = stream.read()
        new = data[: data.rfind(b"\n") + 1]  # what follows is still being written
        for line in new.splitlines(keepends=True):
            problem, entry = parse_entry(line, self._lines)
            if problem:
                raise RunFolderError(f"{path}: line {self._lines + 1} {problem}")
            self._at += len(line)
            self._lines += 1
            self._take(plan, entry, in_session=self._at > self._known_bytes)
        return bool(new)

    def seen(self, *, ended: bool = False) -> Seen:
        """Current state; `ended` is True if the recording process has ended."""
        done, total = len(self._saved), len(self._shots)
        state = self._state(complete=0 < done == total, ended=ended)
        return replace(self._seen, state=state, done=done, total=total, left_s=self._eta.left_s())

    def _note(self, **changed: Any) -> None:
        self._seen = replace(self._seen, **changed)

    def _state(self, *, complete: bool, ended: bool) -> State:
        if complete:
            return "finished"
        if ended:
            return "stopped" if self._event == "stopped" else "broken off"
        if self._event == "approaching":
            return "approaching"
        return "recording" if self._event else "preparing"

    def _take(self, plan: Plan, entry: Entry, *, in_session: bool) -> None:
        event = entry["event"]
        if event == "saved":
            self._saved.add(entry["shot"])
            self._note(last=entry)
        if event in ("rejected", "lost"):
            self._note(**{event: getattr(self._seen, event) + 1})
        if not in_session:
            return
        if event in ("unsafe", "made safe"):
            self._note(alarms=tuple(str(problem) for problem in entry.get("problems", ())))
            return
        self._event = event
        now_s = datetime.fromisoformat(entry["time"]).timestamp()
        if self._begin_s is None:
            self._begin_s = self._before_s = now_s
        time_s = now_s - self._begin_s
        if event == "start":
            missing = [shot for name, shot in self._shots.items() if name not in self._saved]
            self._eta.plan(
                backgrounds=len({shot.background for shot in missing}), shots=len(missing)
            )
        elif event in ("approaching", "stable") and {"background_K", "reading_K"} <= set(entry):
            setpoint_K = entry["background_K"]
            does = "is stable at" if event == "stable" else "goes to"
            self._note(doing=f"the black body {does} {setpoint_K:g} K")
            self._read(Reading(time_s, entry["reading_K"], setpoint_K))
            if event == "stable":
                self._eta.add("background", float(entry.get("elapsed_s", 0.0)))
        elif event in ("fired", "saved", "rejected", "lost"):
            self._shot(plan, entry, time_s, now_s)
        if event != "fired":
            self._before_s = now_s

    def _shot(self, plan: Plan, entry: Entry, time_s: float, now_s: float) -> None:
        shot = self._shots.get(entry.get("shot", ""))
        if shot is None:
            return
        reason = f" ({entry['reason']})" if entry.get("reason") else ""
        self._note(doing=f"{plan.describe(shot)}: {entry['event']}{reason}")
        if entry["event"] == "saved" and not entry.get("adopted"):
            # somebody may set the clock back
            self._eta.add("shot", max(now_s - self._before_s, 0.0))
            if "background_after_K" in entry:
                self._read(Reading(time_s, entry["background_after_K"], shot.background_K))

    def _read(self, reading: Reading) -> None:
        self._note(readings=(*self._seen.readings, reading))
