"""Output, errors as messages, and progress of every command."""

import sys
from collections.abc import Callable, Iterable
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Column, Table

from cldit.cli.program import Exit
from cldit.errors import ClditError
from cldit.prepare.stages import StageLine
from cldit.rig.errors import Aborted

if TYPE_CHECKING:  # used by every command, of which few acquire
    from cldit.acquisition.progress import Progress

P = ParamSpec("P")
R = TypeVar("R")
OUT = Console(highlight=False, soft_wrap=True, emoji=False)  # `:x:` in a name stays
ERR = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def plain_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Turns errors of cldit, and of the system about a path, into messages.

    All others keep their traceback.
    """

    @wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except ClditError as error:
            print_problem(str(error))
            sys.exit(Exit.STOPPED if isinstance(error, Aborted) else Exit.FAILED)
        except OSError as error:
            if error.filename is None:
                raise
            print_problem(f"{error.filename}: {error.strerror}")
            sys.exit(Exit.FAILED)
        except KeyboardInterrupt:
            ERR.print("stopped; run the same command again to continue")
            sys.exit(Exit.STOPPED)

    return guarded


def print_problem(message: str) -> None:
    """Prints an error to the standard error."""
    ERR.print(f"[bold red]error:[/] {escaped(message)}")


def print_table(*heads: str, rows: Iterable[Iterable[RenderableType]]) -> None:
    """Prints a table with these heads; in a narrow terminal, cells are folded and never cut."""
    table = Table(*(Column(head, overflow="fold") for head in heads), box=None)
    for row in rows:
        table.add_row(*row)
    OUT.print(table)


def escaped(string: str) -> str:
    """Text in which rich finds no markup."""
    return string.replace("[", r"\[")


def say(line: str) -> None:
    """Prints a line of progress."""
    OUT.print(f"  {escaped(line)}", style="dim")


class ProgressBar:
    """Bar that names the present stage, and lines of text that stay; with `stages`, of each."""

    def __init__(self, *, stages: bool = False) -> None:
        self._stages = stages
        self._bar = Bar(
            TextColumn("  {task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=OUT,
            transient=True,
            disable=not (OUT.is_terminal and OUT.file.isatty()),  # FORCE_COLOR is set in notebooks
        )
        self._task: Any = None
        self._said: set[str] = set()

    def __enter__(self) -> "ProgressBar":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def say(self, line: str) -> None:
        """Shows a stage in the bar; prints any other line once, and the bar starts anew below."""
        stage = isinstance(line, StageLine)
        if not stage and line in self._said:
            return
        self._said.add(line)
        if self._task is not None:
            if not stage or self._stages:
                self._bar.stop()
            self._bar.remove_task(self._task)
            self._task = None
        if not stage or self._stages:
            say(line)
        else:
            self._show(line, 0, None)

    def watch(self, progress: "Progress") -> None:
        """Shows the progress of an acquisition, and how far the black body is."""
        doing = str(progress.approach or progress.phase)
        self.count(doing, progress.done, progress.total)

    def count(self, label: str, done: int, total: int) -> None:
        """Shows that `done` of `total` parts of a piece of work are done."""
        self._show(label, done, total)

    def _show(self, label: str, done: int, total: int | None) -> None:
        if self._task is None:
            self._task = self._bar.add_task(label, total=total)
            self._bar.start()
        self._bar.update(self._task, description=label, completed=done, total=total)
