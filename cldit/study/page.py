"""The page of a study: HTML and Markdown with pictures, verdicts, tables, and what repeats it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version

from cldit.scene import Scene, dump_scene
from cldit.show.report.html import Picture, render
from cldit.study.verdict import Verdict, summary

Row = Mapping[str, float | str]


@dataclass(frozen=True, kw_only=True)
class Page:
    """What a study found.

    about: what it is of, one sentence. command: that makes the page. text: one paragraph, and
    findings: sentences, all made from the figures. pictures: by file name without its ending.
    table: rows of equal keys, units in the keys' names; more: further ones by their titles.
    """

    name: str
    title: str
    about: str = ""
    figure: str = ""
    command: str = ""
    text: str = ""
    findings: Sequence[str] = ()
    pictures: Mapping[str, Picture]
    table: Sequence[Row]
    more: Mapping[str, Sequence[Row]] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ()
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    quick: bool = False
    seconds: float = 0.0

    @property
    def summary(self) -> str:
        """The verdicts in a sentence."""
        return summary(self.verdicts) if self.verdicts else "Nothing is claimed."


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.4g}" if math.isfinite(value) else "–"


def _cells(rows: Sequence[Row]) -> list[list[str]]:
    return [[_cell(value) for value in row.values()] for row in rows]


def _verdict_rows(page: Page) -> list[list[str]]:
    return [
        [
            each.claim,
            each.found,
            each.allowed,
            each.word + (f": {each.why}" if each.why and not each.agrees else ""),
        ]
        for each in page.verdicts
    ]


_VERDICTS = ["the paper", "found", "agrees if", ""]


def page_html(page: Page) -> str:
    """One file: no other file, no network."""
    tables = {title: rows for title, rows in {"Numbers": page.table, **page.more}.items() if rows}
    return render(
        "study.html",
        page=page,
        verdicts=(_VERDICTS, _verdict_rows(page)),
        tables=[(title, list(rows[0]), _cells(rows)) for title, rows in tables.items()],
        scenes={name: dump_scene(scene) for name, scene in page.scenes.items()},
        version=version("cldit"),
    )


def markdown_table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown, `rows` below their `titles`."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    return "\n".join([line(titles), line(["---"] * len(titles)), *map(line, rows)])


def page_markdown(page: Page) -> str:
    """The same with pictures as files beside it."""
    parts = [f"# {page.title}", f"{page.about} Made by `{page.command}`."]
    for name, picture in page.pictures.items():
        parts.append(f"![{picture.caption}]({picture_file(page, name)})")
    if page.text:
        parts.append(page.text)
    if page.findings:
        parts.append("\n".join(f"- {each}" for each in page.findings))
    if page.verdicts:
        parts += [page.summary, markdown_table(_VERDICTS, _verdict_rows(page))]
    for title, rows in {"": page.table, **page.more}.items():
        if rows:
            parts += [f"## {title}"] * bool(title)
            parts.append(markdown_table(list(rows[0]), _cells(rows)))
    return "\n\n".join(parts) + "\n"


def picture_file(page: Page, name: str) -> str:
    """Name of the file of a picture `name` of a `page`."""
    return f"study-{page.name}-{name}.png"
