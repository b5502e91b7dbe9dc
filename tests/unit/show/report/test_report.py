"""The report: one file, well-formed, nothing from outside, user text never becomes markup."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from cldit.show.report.html import Picture, ReportContent, report_html, write_report

VOID = {"meta", "img", "input"}
EVIL = "<script>alert('x')</script>\" onload=\"y &amp;"


class _Checked(HTMLParser):
    """Collects tags, and refuses what is not closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def _parsed(content: ReportContent) -> _Checked:
    parser = _Checked()
    parser.feed(report_html(content))
    parser.close()
    assert parser.open == []
    return parser


def _full(text: str) -> ReportContent:
    picture = Picture(b"\x89PNG not really", text)
    return ReportContent(
        name=text,
        description=text,
        maps=(picture,),
        camera=((400.0, picture), (440.0, picture), (480.5, picture)),
        shares={"vapour": 0.25, text: 0.5},
        share_pictures=(picture,),
        more_pictures=(picture,),
        reasons={"evaluated": 75, text: 25},
        figures={text: text},
        trace={text: text},
        commands=(text,),
        stages=(("trace", 3.0), (text, 1.0)),
        notes={text: text},
        device=text,
        versions={text: text},
        scene_yaml=text,
    )


def test_contents() -> None:
    parser = _parsed(_full("gdi"))
    headings = re.findall(r"<h2>(.*?)</h2>", report_html(_full("gdi")))
    assert headings[:2] == ["Emissivity and apparent temperature", "What the camera saw"]
    assert headings[-1] == "To repeat it"
    for expected in ("25.0 %", "75.0 %", "3.00 s", "4.00 s", "Background at 480.5 K"):
        assert expected in parser.text
    images = [attrs for tag, attrs in parser.tags if tag == "img"]
    assert len(images) == 6
    head = "data:image/png;base64,"
    for attrs in images:
        source = attrs["src"] or ""
        assert source.startswith(head)
        assert base64.b64decode(source.removeprefix(head)) == b"\x89PNG not really"
    slider = [attrs for tag, attrs in parser.tags if tag == "input"]
    assert [(s["min"], s["max"]) for s in slider] == [("0", "2")]
    assert "400 K|440 K|480.5 K" in parser.text  # what the label beside the slider takes turns in
    names = {"viewport"} & {attrs.get("name") for tag, attrs in parser.tags if tag == "meta"}
    assert names == {"viewport"}


def test_user_text_stays_text() -> None:
    parser = _parsed(_full(EVIL))
    plain = _parsed(_full("gdi"))
    assert [tag for tag, _ in parser.tags] == [tag for tag, _ in plain.tags]
    for (_, dirty), (_, clean) in zip(parser.tags, plain.tags, strict=True):
        assert set(dirty) == set(clean)  # no attribute slipped in
    assert parser.text.count("alert('x')") >= 10
    # What was typed is what is read: `&amp;` was text, not an entity.
    assert EVIL in parser.text


def test_nothing_from_outside() -> None:
    text = report_html(_full("gdi"))
    assert not re.search(r"https?://|src=\"(?!data:)|href=|@import|url\(", text)


def test_empty_sections_are_left_out() -> None:
    parser = _parsed(ReportContent(name="bare"))
    assert "h2" not in [tag for tag, _ in parser.tags]
    one = _parsed(ReportContent(name="one", camera=((400.0, Picture(b"x", "")),)))
    assert "input" not in [tag for tag, _ in one.tags]  # nothing to slide over


def test_written_whole(tmp_path: Path) -> None:
    path = tmp_path / "with space" / "report.html"
    path.parent.mkdir()
    write_report(path, _full("Spray µ 日本"))
    assert path.read_text(encoding="utf-8") == report_html(_full("Spray µ 日本"))
    assert [item.name for item in path.parent.iterdir()] == ["report.html"]
    with pytest.raises(OSError):
        write_report(tmp_path / "missing" / "report.html", _full("x"))


def test_only_pictures_of_several_panels_are_wide() -> None:
    for width, height, wide in ((900, 800, False), (1500, 1400, True), (1000, 500, True)):
        size = width.to_bytes(4, "big") + height.to_bytes(4, "big")
        panels = Picture(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + size, "x")
        page = report_html(ReportContent(name="x", maps=(panels,)))
        assert ('<div class="wide">' in page) is wide
