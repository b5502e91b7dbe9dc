"""The page of a study: HTML and Markdown with pictures, verdicts, table, and what repeats it."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.metadata import version
from pathlib import Path

from cldit.errors import StudyError
from cldit.report.html import Picture, document, figures_html, table_html
from cldit.scene import Scene, dump_scene
from cldit.study.verdict import Verdict, summary

Row = Mapping[str, float | str]


@dataclass(frozen=True, kw_only=True)
class Page:
    """What a study found.

    figure: of the paper. text: one paragraph. pictures: by file name without its ending. table:
    rows of equal keys, units in the keys' names.
    """

    name: str
    title: str
    figure: str
    text: str
    pictures: Mapping[str, Picture]
    table: Sequence[Row]
    verdicts: tuple[Verdict, ...] = ()
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    quick: bool = False
    seconds: float = 0.0

    @property
    def command(self) -> str:
        return f"cldit study {self.name}{' --quick' if self.quick else ''}"

    @property
    def summary(self) -> str:
        return summary(self.verdicts) if self.verdicts else "Nothing is claimed."

    @property
    def about(self) -> str:
        reduced = ", with reduced pixels and accuracy" if self.quick else ""
        return f"The paper's {self.figure}{reduced}."


def _cells(row: Row) -> list[str]:
    return [value if isinstance(value, str) else f"{value:.4g}" for value in row.values()]


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
    titles = list(page.table[0]) if page.table else []
    scenes = "".join(
        f"<details><summary>{escape(name)}</summary><pre>{escape(dump_scene(scene))}</pre>"
        "</details>\n"
        for name, scene in page.scenes.items()
    )
    repeat = f"<p><code>{escape(page.command)}</code>, cldit {escape(version('cldit'))}</p>\n"
    return document(
        page.title,
        f"<p>{escape(page.about)}</p>\n",
        [
            ("", figures_html(tuple(page.pictures.values())) + f"<p>{escape(page.text)}</p>\n"),
            (
                f"Against the paper: {page.summary}" if page.verdicts else "",
                table_html(_VERDICTS, _verdict_rows(page)) if page.verdicts else "",
            ),
            ("Numbers", table_html(titles, [_cells(row) for row in page.table])),
            ("To repeat it", repeat + scenes),
        ],
    )


def _markdown_table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    return "\n".join([line(titles), line(["---"] * len(titles)), *map(line, rows)])


def page_markdown(page: Page, *, level: int = 1) -> str:
    """The same with pictures as files beside it."""
    parts = [f"{'#' * level} {page.title}", f"{page.about} Made by `{page.command}`."]
    for name, picture in page.pictures.items():
        parts.append(f"![{picture.caption}]({picture_file(page, name)})")
    parts.append(page.text)
    if page.verdicts:
        parts += [page.summary, _markdown_table(_VERDICTS, _verdict_rows(page))]
    if page.table:
        parts.append(_markdown_table(list(page.table[0]), [_cells(row) for row in page.table]))
    return "\n\n".join(parts) + "\n"


def picture_file(page: Page, name: str) -> str:
    return f"study-{page.name}-{name}.png"


def write_page(page: Page, folder: Path) -> Path:
    """Writes NAME.html, .md, .csv, .json, the pictures and the scenes; returns the HTML's path.

    Raises:
        StudyError: a file cannot be written.
    """
    try:
        (folder / "scenes").mkdir(parents=True, exist_ok=True)
        for name, picture in page.pictures.items():
            (folder / picture_file(page, name)).write_bytes(picture.png)
        for name, scene in page.scenes.items():
            path = folder / "scenes" / f"{page.name}-{name}.yaml"
            path.write_text(dump_scene(scene), encoding="utf-8")
        for ending, text in (
            ("md", page_markdown(page)),
            ("csv", _csv(page)),
            ("json", _json(page)),
            ("html", page_html(page)),  # last: where it is, all is
        ):
            (folder / f"{page.name}.{ending}").write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error})") from error
    return folder / f"{page.name}.html"


def _csv(page: Page) -> str:
    stream = io.StringIO()
    if page.table:
        writer = csv.DictWriter(stream, list(page.table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(page.table)
    return stream.getvalue()


def _json(page: Page) -> str:
    verdicts = [
        {
            "claim": each.claim,
            "found": each.found,
            "value": each.value,
            "unit": each.unit,
            "low": each.low,
            "high": each.high,
            "agrees": each.agrees,
        }
        for each in page.verdicts
    ]
    return json.dumps(
        {
            "study": page.name,
            "figure": page.figure,
            "quick": page.quick,
            "seconds": round(page.seconds, 1),
            "verdicts": verdicts,
            "table": [dict(row) for row in page.table],
        },
        indent=1,
    )


def overview(pages: Sequence[Page], *, level: int = 1) -> str:
    """Markdown: every study's result in a line, then the pages themselves."""
    rows = [
        [
            f"[{page.name}](#{page.title.lower().replace(' ', '-')})",
            page.figure,
            page.summary,
            f"{page.seconds:.0f} s",
        ]
        for page in pages
    ]
    head = _markdown_table(["study", "the paper's", "", "took"], rows)
    return "\n".join([head, "", *(page_markdown(page, level=level + 1) for page in pages)])
