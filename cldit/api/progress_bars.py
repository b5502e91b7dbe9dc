"""Display of progress: a bar in a notebook, lines and a bar in a terminal."""

import sys
from contextlib import AbstractContextManager
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, Self

if TYPE_CHECKING:
    from cldit.acquisition.progress import Progress


class Watcher(Protocol):
    """Display of progress: `say` takes lines, `watch` the progress of a rig."""

    def say(self, line: str) -> None:
        """Shows a line of text."""
        ...

    def watch(self, progress: "Progress") -> None:
        """Shows the progress of a rig."""
        ...


def progress_bar() -> AbstractContextManager[Watcher]:
    """Display of progress for a `with` statement:

    with cldit.progress_bar() as bar:
        run = cldit.simulate("gdi", "runs/gdi", record=True, progress=bar.say, watch=bar.watch)

    Returns:
        Context of a watcher, whose `say` and `watch` take the progress.
    """
    if in_notebook():
        return NotebookBar()
    from cldit.cli.console import ProgressBar  # of the command line

    return ProgressBar()


def in_notebook() -> bool:
    """True in a Jupyter kernel."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and hasattr(shell, "kernel")


class NotebookBar:
    """Line below the cell that changes during the work, and disappears at its end.

    rich's own bar requires ipywidgets in a notebook.
    """

    def __init__(self) -> None:
        self._handle: Any = None

    def __enter__(self) -> Self:
        display = import_module("IPython.display")
        self._handle = display.display(display.HTML(""), display_id=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._show("")

    def say(self, line: str) -> None:
        """Shows a line of text."""
        self._show(f"<small>{escape(line)}</small>")

    def watch(self, progress: "Progress") -> None:
        """Shows a bar of the progress of a rig."""
        self._show(
            f'<progress max="{max(progress.total, 1)}" value="{progress.done}"></progress> '
            f"<small>{escape(progress.phase)} {progress.done}/{progress.total}</small>"
        )

    def _show(self, html: str) -> None:
        self._handle.update(import_module("IPython.display").HTML(html))
