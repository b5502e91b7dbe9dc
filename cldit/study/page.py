"""The page of a study: HTML and Markdown with pictures, verdicts, table, and what repeats it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.metadata import version

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


def markdown_table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    return "\n".join([line(titles), line(["---"] * len(titles)), *map(line, rows)])


def page_markdown(page: Page) -> str:
    """The same with pictures as files beside it."""
    parts = [f"# {page.title}", f"{page.about} Made by `{page.command}`."]
    for name, picture in page.pictures.items():
        parts.append(f"![{picture.caption}]({picture_file(page, name)})")
    parts.append(page.text)
    if page.verdicts:
        parts += [page.summary, markdown_table(_VERDICTS, _verdict_rows(page))]
    if page.table:
        parts.append(markdown_table(list(page.table[0]), [_cells(row) for row in page.table]))
    return "\n\n".join(parts) + "\n"


def picture_file(page: Page, name: str) -> str:
    return f"study-{page.name}-{name}.png"
