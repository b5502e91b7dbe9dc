"""What every command shares: output, errors as messages, and progress."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from cldit.errors import ClditError

if TYPE_CHECKING:  # every command is here, and few acquire
    from cldit.acquisition.progress import Progress

P = ParamSpec("P")
OUT = Console(highlight=False, soft_wrap=True)
ERR = Console(stderr=True, highlight=False, soft_wrap=True)


def plain_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Errors that cldit raises on purpose are messages, and so is a path that the system refuses;
    everything else keeps its traceback."""

    @wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except ClditError as error:
            ERR.print(f"[bold red]error:[/] {escaped(str(error))}")
            sys.exit(1)
        except OSError as error:
            if error.filename is None:
                raise
            reason = f"{error.filename}: {error.strerror}"
            ERR.print(f"[bold red]error:[/] {escaped(reason)}")
            sys.exit(1)
        except KeyboardInterrupt:
            ERR.print("stopped; run the same command again to go on")
            sys.exit(130)

    return guarded


def escaped(text: str) -> str:
    """Text without rich's markup."""
    return text.replace("[", r"\[")


def say(text: str) -> None:
    """Prints a line of progress."""
    OUT.print(f"  {escaped(text)}", style="dim")


class ProgressBar:
    """Lines of text as stages begin, and a bar while the rig records."""

    def __init__(self) -> None:
        self._bar = Bar(
            TextColumn("  {task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeRemainingColumn(),
            console=OUT,
            transient=True,
            disable=not OUT.is_terminal,  # else it leaves empty lines in a file or pipe
        )
        self._task: Any = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def say(self, text: str) -> None:
        """Prints a line; the bar starts anew below it."""
        if self._task is not None:
            self._bar.stop()
            self._bar.remove_task(self._task)
            self._task = None
        say(text)

    def watch(self, progress: Progress) -> None:
        """Shows how far the work is."""
        self.count(progress.phase, progress.done, progress.total)

    def count(self, what: str, done: int, total: int) -> None:
        """Shows how much of a piece of work is done.

        Args:
            what: is in work.
            done: parts of it that are done.
            total: all parts.
        """
        if self._task is None:
            self._task = self._bar.add_task(what, total=total)
            self._bar.start()
        self._bar.update(self._task, description=what, completed=done, total=total)
