"""Progress for whoever watches: a bar in a notebook, lines and a bar in a terminal."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, Self

if TYPE_CHECKING:
    from cldit.acquisition.progress import Progress


class Watcher(Protocol):
    """What shows progress: `say` takes lines, `watch` what a rig has done."""

    def say(self, text: str) -> None:
        """Shows a line `text`."""
        ...

    def watch(self, progress: Progress) -> None:
        """Shows how far the work is, as `progress` tells."""
        ...


def progress_bar() -> AbstractContextManager[Watcher]:
    """Shows progress, as in

    with cldit.progress_bar() as bar:
        run = cldit.run_experiment("gdi", "runs/gdi", progress=bar.say, watch=bar.watch)
    """
    if in_notebook():
        return NotebookBar()
    from cldit.cli.console import ProgressBar  # the terminal's, which is the command line's

    return ProgressBar()


def in_notebook() -> bool:
    """Whether this runs in a Jupyter kernel."""
    found = sys.modules.get("IPython")
    shell = None if found is None else found.get_ipython()
    return shell is not None and hasattr(shell, "kernel")


class NotebookBar:
    """One line below the cell that changes as the work goes on, and goes when it is done.

    rich's own bar needs ipywidgets in a notebook, and shows nothing without.
    """

    def __init__(self) -> None:
        self._handle: Any = None

    def __enter__(self) -> Self:
        display = import_module("IPython.display")
        self._handle = display.display(display.HTML(""), display_id=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._show("")

    def say(self, text: str) -> None:
        """Shows what is in work: `text`."""
        self._show(f"<small>{escape(text)}</small>")

    def watch(self, progress: Progress) -> None:
        """Shows a bar of how far the work is, as `progress` tells."""
        self._show(
            f'<progress max="{max(progress.total, 1)}" value="{progress.done}"></progress> '
            f"<small>{escape(progress.phase)} {progress.done}/{progress.total}</small>"
        )

    def _show(self, html: str) -> None:
        self._handle.update(import_module("IPython.display").HTML(html))
