"""Page of a study: verdicts, sentences, figures and tables, as HTML, Markdown, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cldit.errors import StudyError
from cldit.io.files import make_folder, write_text
from cldit.io.origin import commit
from cldit.io.plain_data import read_json
from cldit.scene import Scene, dump_scene
from cldit.show import page as show
from cldit.show.page import Block, Bullets, Details, Figure, Link, Section, Table

Row = Mapping[str, float | str]

_VERDICTS = ("the paper", "found", "agrees if", "")
_OVERVIEW = ("study", "the paper's", "size", "took / s", "against the paper")


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One statement of the paper and the value that was found, in `unit`.

    It agrees if the value is between low and high; None: no limit. NaN agrees with nothing. why:
    the reason if it does not agree.
    """

    claim: str
    value: float
    unit: str = ""
    low: float | None = None
    high: float | None = None
    why: str = ""

    @property
    def agrees(self) -> bool:
        """True if the value is within the limits."""
        if not math.isfinite(self.value):
            return False
        above = self.low is None or self.value >= self.low
        return above and (self.high is None or self.value <= self.high)

    @property
    def found(self) -> str:
        """Value with its unit."""
        return _with_unit(self.value, self.unit) if math.isfinite(self.value) else "no value"

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

    @property
    def word(self) -> str:
        """`agrees` or `disagrees`."""
        return "agrees" if self.agrees else "disagrees"


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip()


def summary(verdicts: tuple[Verdict, ...]) -> str:
    """Sentence with the number of statements that agree."""
    agreed = sum(each.agrees for each in verdicts)
    if agreed == len(verdicts):
        return f"All {agreed} statements agree."
    return f"{agreed} of {len(verdicts)} statements agree."


@dataclass(frozen=True, kw_only=True)
class StudyPage:
    """Results of a study.

    about: its subject, one sentence. command: makes the page. text: one paragraph. findings:
    sentences. figures: by file name without suffix. table: rows of equal keys, with units
    in their names; more: further tables by title.
    """

    name: str
    title: str
    about: str = ""
    figure: str = ""
    command: str = ""
    text: str = ""
    findings: Sequence[str] = ()
    figures: Mapping[str, Figure]
    table: Sequence[Row]
    more: Mapping[str, Sequence[Row]] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ()
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    quick: bool = False
    seconds: float = 0.0

    @property
    def summary(self) -> str:
        """Sentence about the verdicts."""
        return summary(self.verdicts) if self.verdicts else "Nothing is claimed."

    def html(self) -> show.Page:
        """Page as one file."""
        tables = {"Numbers": self.table, **self.more}
        scenes = [Details(name, dump_scene(scene)) for name, scene in self.scenes.items()]
        made = f"`{self.command}`, cldit {version('cldit')}"
        content: list[Block] = [
            self.about,
            Section("", [*self.figures.values(), self.text]),
            Section("Findings", [Bullets(self.findings)] if self.findings else []),
            Section(f"Against the paper: {self.summary}", [self._verdicts()]),
            *(Section(title, [_table(rows)]) for title, rows in tables.items()),
            Section("To repeat it", [made, *scenes]),
        ]
        return show.Page(self.title, content)

    def markdown(self, *, tables: bool) -> show.Page:
        """Page with figures as files beside it. Without `tables`, as in docs, numbers are in the
        JSON, and it states the commit."""
        made = commit()
        at = f" at commit {made[:7] + made[40:]}" if made and not tables else ""
        figures = [
            Figure(each.png, each.caption, f"study-{self.name}-{name}.png")
            for name, each in self.figures.items()
        ]
        content: list[Block] = [
            f"{self.about} Made by `{self.command}`{at}.",
            *figures,
            self.text,
        ]
        if self.findings:
            content.append(Bullets(self.findings))
        if self.verdicts:
            content += [self.summary, self._verdicts()]
        if tables:
            content += [Section(title, [_table(rows)])
                        for title, rows in {"": self.table, **self.more}.items()]  # fmt: skip
        else:
            content.append(f"All numbers are in `{self.name}.json`.")
        return show.Page(self.title, content)

    def _verdicts(self) -> Table:
        return Table(_VERDICTS, [
            (each.claim, each.found, each.allowed,
             each.word + (f": {each.why}" if each.why and not each.agrees else ""))
            for each in self.verdicts
        ])  # fmt: skip

    def json(self) -> str:
        """All numbers and sentences."""
        data = {
            "study": self.name,
            "title": self.title,
            "figure": self.figure,
            "quick": self.quick,
            "seconds": round(self.seconds, 1),
            "summary": self.summary,
            "text": self.text,
            "findings": list(self.findings),
            "verdicts": [
                {
                    "claim": each.claim,
                    "found": each.found,
                    "value": _plain(each.value),
                    "unit": each.unit,
                    "low": each.low,
                    "high": each.high,
                    "agrees": each.agrees,
                }
                for each in self.verdicts
            ],
            "table": _plain_rows(self.table),
        }
        if self.more:
            data["more"] = {title: _plain_rows(rows) for title, rows in self.more.items()}
        return json.dumps(data, indent=1)

    def csv(self) -> str:
        """Rows of the table."""
        stream = io.StringIO()
        if self.table:
            writer = csv.DictWriter(stream, list(self.table[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.table)
        return stream.getvalue()


def _plain(value: float | str) -> float | str | None:
    """Value for JSON, which has no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _plain_rows(rows: Sequence[Row]) -> list[dict[str, float | str | None]]:
    return [{key: _plain(value) for key, value in row.items()} for row in rows]


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.4g}" if math.isfinite(value) else "–"


def _table(rows: Sequence[Row]) -> Table:
    titles = list(rows[0]) if rows else []
    return Table(titles, [[_cell(value) for value in row.values()] for row in rows])


def write_page(page: StudyPage, folder: Path, *, markdown_only: bool = False) -> Path:
    """Writes NAME.html, .md, .json, .csv, the figures and the scenes; returns the page's path.

    With `markdown_only`, as for docs, only figures, .json and .md, without tables of numbers.

    Raises:
        StudyError: a file cannot be written.
    """
    path = folder / page.name
    try:
        make_folder(folder)
        write_text(path.with_name(f"{page.name}.json"), page.json())
        markdown = path.with_name(f"{page.name}.md")
        written = show.write_page(page.markdown(tables=not markdown_only), markdown)
        if not markdown_only:
            make_folder(folder / "scenes")
            for name, scene in page.scenes.items():
                write_text(folder / "scenes" / f"{page.name}-{name}.yaml", dump_scene(scene))
            write_text(path.with_name(f"{page.name}.csv"), page.csv())
            written = show.write_page(page.html(), path.with_name(f"{page.name}.html"))
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error})") from error
    return written


def write_overview(folder: Path, names: Sequence[str], *, markdown_only: bool = False) -> Path:
    """Writes overview.html and .md with a row for each study that is in the folder.

    Raises:
        StudyError: the file of a page is damaged, or the overview cannot be written.
    """
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
    whole = all(isinstance(data.get(name), str) for name in texts)
    if not whole or not isinstance(data.get("seconds"), (int, float)) or "quick" not in data:
        raise StudyError(f"{path}: is damaged; run the study again")
    return (
        Link(data["title"], data["study"]),
        data["figure"],
        "quick" if data["quick"] else "full",
        f"{data['seconds']:.0f}",
        data["summary"],
    )
