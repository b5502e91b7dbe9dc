"""The stages of a run, timed as they go."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from cldit.io.progress import Watch, silent

Say = Callable[[str], None]


@dataclass(frozen=True)
class Stage:
    """One step of a run: what it took, and a word on what it did or why it was left out."""

    name: str
    seconds: float
    note: str = ""


class Stages:
    """Times the stages of a run and tells the user which one is under way."""

    def __init__(self, say: Say | None, watch: Watch = silent) -> None:
        """`watch` is told how far long pieces of work are."""
        self.done: list[Stage] = []
        self.remarks: list[str] = []
        self.say = say
        self.watch = watch

    def remark(self, remarks: Sequence[str]) -> None:
        """What a stage inferred and the user should know; kept for the report."""
        self.remarks += remarks
        for text in remarks:
            self.tell(text)

    def tell(self, text: str) -> None:
        """Tells the user what is under way."""
        if self.say is not None:
            self.say(text)

    @contextmanager
    def stage(self, name: str) -> Iterator[list[str]]:
        """Times what is done within; texts that are appended to the list are noted with it."""
        self.tell(name)
        note: list[str] = []
        start, before = time.perf_counter(), len(self.done)
        yield note
        inner = sum(stage.seconds for stage in self.done[before:])
        seconds = max(time.perf_counter() - start - inner, 0.0)
        self.done.append(Stage(name, seconds, "; ".join(note)))
