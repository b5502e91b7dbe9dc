"""A study's page as files, and the overview of all pages that lie in a folder."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cldit.errors import StudyError
from cldit.io.files import make_folder, write_bytes, write_text
from cldit.io.plain_data import read_json
from cldit.scene import dump_scene
from cldit.show.report.html import render
from cldit.study.page import Page, Row, markdown_table, page_html, page_markdown, picture_file


def write_page(page: Page, folder: Path, *, markdown_only: bool = False) -> Path:
    """Writes NAME.md, .json and the pictures, and NAME.html, .csv and the scenes too.

    Args:
        page: of a study.
        folder: made if need be.
        markdown_only: nothing but Markdown, JSON and pictures.

    Returns:
        The page's path: HTML, or Markdown where only that is wanted.

    Raises:
        StudyError: a file cannot be written.
    """
    texts = {"json": _json(page), "md": page_markdown(page)}
    if not markdown_only:
        texts |= {"csv": _csv(page), "html": page_html(page)}
    try:
        make_folder(folder)
        for name, picture in page.pictures.items():
            write_bytes(folder / picture_file(page, name), picture.png)
        if not markdown_only:
            make_folder(folder / "scenes")
            for name, scene in page.scenes.items():
                path = folder / "scenes" / f"{page.name}-{name}.yaml"
                write_text(path, dump_scene(scene))
        for ending, text in texts.items():  # the page last: where it is, all is
            write_text(folder / f"{page.name}.{ending}", text)
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error})") from error
    return folder / f"{page.name}.{list(texts)[-1]}"


def _csv(page: Page) -> str:
    stream = io.StringIO()
    if page.table:
        writer = csv.DictWriter(stream, list(page.table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(page.table)
    return stream.getvalue()


def _json(page: Page) -> str:
    def plain(value: float | str | None) -> float | str | None:
        """JSON has no NaN."""
        return None if isinstance(value, float) and not math.isfinite(value) else value

    def rows(table: Sequence[Row]) -> list[dict[str, float | str | None]]:
        return [{key: plain(value) for key, value in row.items()} for row in table]

    verdicts = [
        {
            "claim": each.claim,
            "found": each.found,
            "value": plain(each.value),
            "unit": each.unit,
            "low": each.low,
            "high": each.high,
            "agrees": each.agrees,
        }
        for each in page.verdicts
    ]
    told = {
        "study": page.name,
        "title": page.title,
        "figure": page.figure,
        "quick": page.quick,
        "seconds": round(page.seconds, 1),
        "summary": page.summary,
        "text": page.text,
        "findings": list(page.findings),
        "verdicts": verdicts,
        "table": rows(page.table),
        **(
            {"more": {title: rows(table) for title, table in page.more.items()}}
            if page.more
            else {}
        ),
    }
    return json.dumps(told, indent=1)


def write_overview(folder: Path, names: Sequence[str], *, markdown_only: bool = False) -> Path:
    """Writes overview.md and .html: a line for each of `names` whose page lies in the folder.

    Args:
        folder: with the pages.
        names: of studies.
        markdown_only: no HTML.

    Returns:
        The overview's path: HTML, or Markdown where only that is wanted.

    Raises:
        StudyError: a page's file is damaged, or the overview cannot be written.
    """
    told: list[dict[str, Any]] = []
    for name in names:
        path = folder / f"{name}.json"
        if path.is_file():
            told.append(_told(path))
    titles = ["study", "the paper's", "size", "took / s", "against the paper"]
    rows = [
        [
            one["title"],
            one["figure"],
            "quick" if one["quick"] else "full",
            f"{one['seconds']:.0f}",
            one["summary"],
        ]
        for one in told
    ]
    linked = [
        [f"[{row[0]}]({one['study']}.md)", *row[1:]] for one, row in zip(told, rows, strict=True)
    ]
    texts = {"md": f"# The paper's studies\n\n{markdown_table(titles, linked)}\n"}
    if not markdown_only:
        lines = [(f"{one['study']}.html", row) for one, row in zip(told, rows, strict=True)]
        texts["html"] = render("overview.html", lines=lines)
    try:
        for ending, text in texts.items():
            write_text(folder / f"overview.{ending}", text)
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error})") from error
    return folder / f"overview.{list(texts)[-1]}"


def _told(path: Path) -> dict[str, Any]:
    """What the overview tells of one study; raises StudyError."""
    data = read_json(path, error=StudyError)
    texts = ("study", "title", "figure", "summary")
    whole = all(isinstance(data.get(name), str) for name in texts)
    if not whole or not isinstance(data.get("seconds"), (int, float)) or "quick" not in data:
        raise StudyError(f"{path}: is damaged; run the study again")
    return data
