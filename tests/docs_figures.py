"""Figures of the docs, made anew: `python -m tests.docs_figures [NAME...]`, in docs/.

Some minutes of a core for all. `python -m tests.viewed` makes that of the viewer, `python -m
tests.bench gallery` those of the gallery, and `cldit study` and `cldit bench` those of their pages.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

from click.testing import CliRunner

import cldit
from cldit.bench.budget import budget_figure, stored_rows
from cldit.cli import main
from cldit.show.figures.style import write_figure
from cldit.show.report.comparison_page import comparison_figure

DOCS = Path(__file__).resolve().parents[1] / "docs"


def _cldit(*words: str | Path) -> None:
    CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)


def _gdi(work: Path) -> None:
    _cldit("run", "gdi", "--out", work)
    write_figure(cldit.open_run(work).plot("summary"), DOCS / "gdi.png")


def _times(work: Path) -> None:
    times = "0.2ms,0.4ms,0.6ms,0.8ms,0.95ms"
    _cldit("run", "gdi-cone", "--quick", "--times", times, "--out", work)
    copyfile(work / "film.gif", DOCS / "gdi-times.gif")


def _methane(work: Path) -> None:
    _cldit("run", "methane-jet", "--trace-only", "--out", work)
    write_figure(cldit.open_run(work).plot(), DOCS / "methane-jet.png")


def _wavelengths(work: Path) -> None:
    _cldit("run", "gdi-cone", "--preset", "spectral", "--out", work)
    copyfile(work / "pictures" / "wavelengths.png", DOCS / "wavelengths.png")


def _plan(work: Path) -> None:
    _cldit("plan", "gdi-cone", "--error", "2K", "--out", work)
    copyfile(work / "design.png", DOCS / "plan-gdi.png")


def _flow(work: Path) -> None:
    _cldit("show", "gdi", "--part", "spray", "--out", work)
    copyfile(work / "views.png", DOCS / "gdi-flow.png")


def _compare(work: Path) -> None:
    runs = {"all orders": (), "order 1": ("--order", "1")}
    for name, words in runs.items():
        sizes = ("--pixels", "200", "--accuracy", "4")
        _cldit("run", "gdi-cone", *sizes, "--trace-only", *words, "--out", work / name)
    found = cldit.compare(*(work / name for name in runs)).differences[0]
    write_figure(comparison_figure(found), DOCS / "compare.png")


def _budget(_: Path) -> None:
    folder = DOCS / "benchmarks"
    rows = [row for row in stored_rows(folder, pixels=100) if row.seed == 1]
    write_figure(budget_figure(rows), folder / "budget.png")


MADE: dict[str, Callable[[Path], None]] = {
    "gdi": _gdi,
    "times": _times,
    "methane-jet": _methane,
    "wavelengths": _wavelengths,
    "plan": _plan,
    "gdi-flow": _flow,
    "compare": _compare,
    "optics": lambda _: _cldit("show", "gdi", "--part", "optics", "--out", DOCS / "optics-gdi.png"),
    "budget": _budget,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or MADE:
        with TemporaryDirectory() as scratch:
            MADE[name](Path(scratch) / name)
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()
