"""The stages of a run, timed as they go."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from cldit.io.progress import Watch, silent

Say = Callable[[str], None]


class StageLine(str):
    """Line that names the work that begins; all other lines of progress are remarks to keep."""

    __slots__ = ()


@dataclass(frozen=True)
class Stage:
    """One step of a run: its time, and a note on the work done or on why it was skipped."""

    name: str
    seconds: float
    note: str = ""


class Stages:
    """Times the stages of a run, and reports them and its remarks to the user.

    `say` takes lines of text, `watch` the progress of long pieces of work.
    """

    def __init__(self, say: Say | None, watch: Watch = silent) -> None:
        self.done: list[Stage] = []
        self.remarks: list[str] = []
        self.say = say
        self.watch = watch

    def remark(self, remarks: Sequence[str]) -> None:
        """Reports inferences and problems, each once, and keeps them for the report."""
        for remark in remarks:
            if remark in self.remarks:
                continue
            self.remarks.append(remark)
            if self.say is not None:
                self.say(remark)

    def tell(self, work: str) -> None:
        """Reports the work in progress."""
        if self.say is not None:
            self.say(StageLine(work))

    @contextmanager
    def stage(self, name: str) -> Iterator[list[str]]:
        """Times the work within, without that of inner stages; the list takes notes on it."""
        self.tell(name)
        note: list[str] = []
        start, done_before = time.perf_counter(), len(self.done)
        yield note
        inner = sum(stage.seconds for stage in self.done[done_before:])
        seconds = max(time.perf_counter() - start - inner, 0.0)
        self.done.append(Stage(name, seconds, "; ".join(note)))
