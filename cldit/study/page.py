"""Page of a study: verdicts, sentences, figures and tables, as HTML, Markdown, JSON and CSV."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cldit.errors import StudyError
from cldit.io.files import make_folder, write_text
from cldit.io.origin import commit
from cldit.io.plain_data import read_json
from cldit.io.text_tables import csv_text
from cldit.scene import Scene, dump_scene
from cldit.show import page as show
from cldit.show.figures.style import write_figure
from cldit.show.page import Block, Code, Figure, Link, Section, Table

Row = Mapping[str, float | str]

_VERDICTS = ("the paper", "found", "agrees if", "")
_OVERVIEW = ("study", "the paper's", "size", "against the paper")


AGREES, DISAGREES, OPEN = "agrees", "disagrees", "undecided"
SURE = 2.0  # standard errors between a value and a limit


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One statement of the paper and the value that was found, in `unit`, with its standard error.

    It agrees if the value is between low and high; None: no limit. A value that is closer to a
    limit than two errors can tell nothing, nor can one that is not finite. error: 0 for a value
    that repetition does not change. why: the reason if it does not agree.
    """

    claim: str
    value: float
    error: float = 0.0
    unit: str = ""
    low: float | None = None
    high: float | None = None
    reason: str = ""

    @property
    def word(self) -> str:
        """`agrees`, `disagrees` or `undecided`."""
        if not math.isfinite(self.value) or math.isnan(self.error):
            return OPEN
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        doubt = SURE * self.error
        if low <= self.value - doubt and self.value + doubt <= high:
            return AGREES
        return DISAGREES if self.value + doubt < low or self.value - doubt > high else OPEN

    @property
    def found(self) -> str:
        """Value with its error and unit."""
        if not math.isfinite(self.value):
            return "no value"
        if self.error == 0:
            return _with_unit(self.value, self.unit)
        return f"{_measured(self.value, self.error)} {self.unit}".rstrip()

    @property
    def allowed(self) -> str:
        """Limits with their unit."""
        if self.low is not None and self.high is not None:
            if self.low == -self.high:
                return f"±{_with_unit(self.high, self.unit)}"
            return f"{self.low:g} to {_with_unit(self.high, self.unit)}"
        if self.high is not None:
            return f"at most {_with_unit(self.high, self.unit)}"
        return f"at least {_with_unit(self.low or 0.0, self.unit)}"


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip()


def _measured(value: float, error: float) -> str:
    """Value to the second digit of its error, and the error."""
    if not math.isfinite(error):
        return f"{value:.3g}, error unknown"
    if error == 0:
        return f"{value:.4g}"
    places = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:z.{places}f} ± {error:.{places}f}"


@dataclass(frozen=True, kw_only=True)
class StudyPage:
    """Results of a study.

    about: its subject, one sentence. figure: of the paper. command: makes the page. text: one
    paragraph. figures: by name, each with its file. table: rows of equal keys, with units in their
    names; row_errors: standard errors of their numbers. seeds: of the sprays whose mean the numbers
    are. quick: reduced pixels and accuracy.
    """

    name: str
    title: str
    about: str = ""
    figure: str = ""
    command: str = ""
    text: str = ""
    figures: Mapping[str, Figure]
    table: Sequence[Row]
    row_errors: Sequence[Mapping[str, float]] = ()
    verdicts: tuple[Verdict, ...] = ()
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    quick: bool = False
    seeds: tuple[int, ...] = ()
    device: str = ""

    @property
    def summary(self) -> str:
        """Sentence with the numbers of statements that agree and that are undecided."""
        words = [verdict.word for verdict in self.verdicts]
        agreed, open_ = words.count(AGREES), words.count(OPEN)
        if not words:
            return "Nothing is claimed."
        if agreed == len(words):
            return f"All {agreed} statements agree."
        rest = f", {open_} undecided" if open_ else ""
        return f"{agreed} of {len(words)} statements agree{rest}."

    def page(self, *, with_tables: bool = True) -> show.Page:
        """The page; without `with_tables`, as in docs, numbers and scenes are in other files."""
        scenes = [
            Section(name, [Code(dump_scene(scene))], level=3, folded=True)
            for name, scene in self.scenes.items()
        ]
        numbers = "" if with_tables else f" (all numbers: `{self.name}.json`)"
        content: list[Block] = [
            f"{self.about} Made by `{self.command}`{numbers}. {self._made()}",
            *self.figures.values(),
            self.text,
            Section(f"Against the paper: {self.summary}", [self._verdicts()]),
            Section("Numbers", [self._numbers()] if with_tables else []),
            Section("Scenes", scenes if with_tables else []),
        ]
        return show.Page(self.title, content)

    def _made(self) -> str:
        """Commit or version, device and seeds."""
        revision = commit()
        parts = [
            f"commit {revision[:7] + revision[40:]}" if revision else f"cldit {version('cldit')}",
            self.device,
            f"mean of seeds {', '.join(map(str, self.seeds))}" if self.seeds else "",
            f"errors by {'seeds, ' if self.seeds else ''}cells of twice the edge"
            if self.row_errors
            else "",
        ]
        return "; ".join(part for part in parts if part)

    def _verdicts(self) -> Table:
        return Table(_VERDICTS, [
            (verdict.claim, verdict.found, verdict.allowed,
             f"{verdict.word}: {verdict.reason}" if verdict.reason and verdict.word == DISAGREES
             else verdict.word)
            for verdict in self.verdicts
        ])  # fmt: skip

    def json(self) -> str:
        """All numbers and sentences."""
        data = {
            "study": self.name,
            "title": self.title,
            "figure": self.figure,
            "quick": self.quick,
            "summary": self.summary,
            "text": self.text,
            "verdicts": _plain_rows(
                {
                    "claim": verdict.claim,
                    "found": verdict.found,
                    "value": verdict.value,
                    "unit": verdict.unit,
                    "low": verdict.low,
                    "high": verdict.high,
                    "error": verdict.error,
                    "verdict": verdict.word,
                }
                for verdict in self.verdicts
            ),
            "table": _plain_rows(self.table),
            "table_errors": _plain_rows(self.row_errors),
            "seeds": list(self.seeds),
            "device": self.device,
        }
        return json.dumps(data, indent=1)

    def csv(self) -> str:
        """Rows of the table, each number followed by its error."""
        rows = [
            {
                column: cell
                for name, value in row.items()
                for column, cell in ((name, value), (f"{name}, error", error.get(name)))
                if cell is not None
            }
            for row, error in self._rows()
        ]
        names = list(rows[0]) if rows else []
        return csv_text(names, ([row.get(name, "") for name in names] for row in rows))

    def _numbers(self) -> Table:
        titles = list(self.table[0]) if self.table else []
        return Table(titles, [
            [_cell(value, error.get(name, 0.0)) for name, value in row.items()]
            for row, error in self._rows()
        ])  # fmt: skip

    def _rows(self) -> Iterator[tuple[Row, Mapping[str, float]]]:
        """Rows of the table with the errors of their numbers."""
        return zip(self.table, self.row_errors or [{} for _ in self.table], strict=True)


def _plain_rows(
    rows: Iterable[Mapping[str, float | str | None]],
) -> list[dict[str, float | str | None]]:
    """Rows for JSON, which has no NaN."""
    return [
        {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in row.items()
        }
        for row in rows
    ]


def _cell(value: float | str, error: float) -> str:
    if isinstance(value, str):
        return value
    return _measured(value, error) if math.isfinite(value) else "–"


def write_page(
    page: StudyPage, folder: Path, *, markdown_only: bool = False, suffix: str | None = None
) -> Path:
    """Writes NAME.html, .md, .json, .csv, the figures and the scenes; returns the page's path.

    With `markdown_only`, as for docs, only figures, .json and .md, without tables of numbers.
    suffix: .pdf or .svg, of one more file of each figure.
    """
    try:
        make_folder(folder)
        write_text(folder / f"{page.name}.json", page.json())
        shown = page.page(with_tables=not markdown_only)
        written = show.write_page(shown, folder / f"{page.name}.md")
        for figure in page.figures.values():
            if suffix is not None and figure.drawn is not None:
                write_figure(figure.drawn, (folder / figure.file).with_suffix(suffix))
        if not markdown_only:
            make_folder(folder / "scenes")
            for name, scene in page.scenes.items():
                write_text(folder / "scenes" / f"{page.name}-{name}.yaml", dump_scene(scene))
            write_text(folder / f"{page.name}.csv", page.csv())
            written = show.write_page(shown, folder / f"{page.name}.html")
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error})") from error
    return written


def write_overview(folder: Path, names: Sequence[str], *, markdown_only: bool = False) -> Path:
    """Writes overview.html and .md with a row for each study that is in the folder."""
    paths = [folder / f"{name}.json" for name in names]
    rows = [_overview_row(path) for path in paths if path.is_file()]
    page = show.Page("The paper's studies", [Table(_OVERVIEW, rows)])
    endings = ("md",) if markdown_only else ("md", "html")
    try:
        written = [show.write_page(page, folder / f"overview.{ending}") for ending in endings]
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error})") from error
    return written[-1]


def _overview_row(path: Path) -> tuple[show.Cell, ...]:
    """Row of a study; raises StudyError."""
    data: dict[str, Any] = read_json(path, error=StudyError)
    texts = ("study", "title", "figure", "summary")
    complete = all(isinstance(data.get(name), str) for name in texts)
    if not complete or "quick" not in data:
        raise StudyError(f"{path}: is damaged; run the study again")
    return (
        Link(data["title"], data["study"]),
        data["figure"],
        "quick" if data["quick"] else "full",
        data["summary"],
    )
