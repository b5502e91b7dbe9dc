"""Progress in a notebook: one display that changes, and a terminal's bar elsewhere."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from cldit.acquisition.progress import Progress
from cldit.api.progress_bars import NotebookBar, progress_bar
from cldit.cli.console import ProgressBar


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What a kernel would show, one after the other."""
    found: list[str] = []
    package: Any = ModuleType("IPython")
    package.get_ipython = lambda: SimpleNamespace(kernel=object())
    display: Any = ModuleType("IPython.display")
    display.HTML = str
    display.display = lambda html, display_id: SimpleNamespace(update=found.append)
    package.display = display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return found


def test_a_notebook_shows_lines_and_a_bar(shown: list[str]) -> None:
    with progress_bar() as bar:
        assert isinstance(bar, NotebookBar)
        bar.say("a < b")
        bar.watch(Progress("shots", 3, 10, None))
    assert shown[0] == "<small>a &lt; b</small>"
    assert '<progress max="10" value="3">' in shown[1] and "shots 3/10" in shown[1]
    assert shown[-1] == ""  # nothing stays


def test_elsewhere_it_is_the_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    with progress_bar() as bar:
        assert isinstance(bar, ProgressBar)
