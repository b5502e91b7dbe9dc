"""Pages: one file, well-formed, nothing from outside, user text never becomes markup."""

from __future__ import annotations

import base64
import io
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

from cldit.show.page import (
    Bar,
    Bullets,
    Cell,
    Code,
    Figure,
    Link,
    Page,
    Section,
    Slider,
    Table,
    write_page,
)

VOID = {"meta", "img", "input"}
EVIL = "<script>alert('x')</script>\" onload=\"y &amp;"
PNG = b"\x89PNG not really"


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


def _parsed(page: Page) -> _Checked:
    parser = _Checked()
    parser.feed(page.html())
    parser.close()
    assert parser.open == []
    return parser


def _full(text: str) -> Page:
    figure = Figure(PNG, text, "figures/one.png")
    shares: list[list[Cell]] = [["vapour", "25.0 %", Bar(0.25)], [text, "50 %", Bar(7)]]
    return Page(
        text,
        [
            text,
            Section("Maps", [figure]),
            Section(text, [Slider(text, {"400 K": figure, "440 K": figure, "480.5 K": figure})]),
            Section("Origin", [Table((), shares, numbers=(1,))]),
            Section("Pairs", [Table.pairs({"name": "value", text: text}), Bullets([text, "one"])]),
            Section("Titles", [Table(["study", text], [[Link(text, "walls"), text]])]),
            Section("How to repeat it", [Code(text)]),
            Section(text, [text], folded=True),
        ],
    )


def test_contents() -> None:
    parser, html = _parsed(_full("gdi")), _full("gdi").html()
    assert re.findall(r"<h2>(.*?)</h2>", html)[0] == "Maps"
    assert "25.0 %" in parser.text and "gdi at 480.5 K. gdi" in parser.text
    assert 'style="width:25.0%"' in html and 'style="width:100.0%"' in html
    images = [attrs for tag, attrs in parser.tags if tag == "img"]
    assert len(images) == 4
    head = "data:image/png;base64,"
    for attrs in images:
        source = attrs["src"] or ""
        assert source.startswith(head) and base64.b64decode(source.removeprefix(head)) == PNG
    slider = [attrs for tag, attrs in parser.tags if tag == "input"]
    assert [(s["min"], s["max"]) for s in slider] == [("0", "2")]
    assert "400 K|440 K|480.5 K" in parser.text  # the values that the slider's label shows in turn
    names = {"viewport"} & {attrs.get("name") for tag, attrs in parser.tags if tag == "meta"}
    assert names == {"viewport"}


def test_user_text_stays_text() -> None:
    parser, plain = _parsed(_full(EVIL)), _parsed(_full("gdi"))
    assert [tag for tag, _ in parser.tags] == [tag for tag, _ in plain.tags]
    for (_, dirty), (_, clean) in zip(parser.tags, plain.tags, strict=True):
        assert set(dirty) - {"class"} == set(clean) - {"class"}  # no attribute slipped in
    assert parser.text.count("alert('x')") >= 10
    # What was typed is what is read: `&amp;` was text, not an entity.
    assert EVIL in parser.text


def test_nothing_from_outside() -> None:
    text = _full("gdi").html().replace('href="walls.html"', "")
    assert not re.search(r"https?://|src=\"(?!data:)|href=|@import|url\(", text)


def test_empty_sections_are_omitted() -> None:
    empty = [Section("a", [""]), Section("b", [Table(("x",), ()), Bullets([]), Slider("c", {})])]
    page = Page("bare", ["", *empty, Section("d", [Section("", [Code("")])])])
    assert not {"h2", "section", "p"} & {tag for tag, _ in _parsed(page).tags}
    assert page.markdown() == "# bare\n\n\n"
    one = _parsed(Page("one", [Slider("Background", {"400 K": Figure(b"x", "")})]))
    assert "input" not in [tag for tag, _ in one.tags]  # nothing to slide over
    assert "Background at 400 K." in one.text


def test_markdown(tmp_path: Path) -> None:
    """The same page as Markdown, with its figures as files beside it."""
    path = write_page(_full("a|b"), tmp_path / "page.md")
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# a|b\n\na|b\n\n## Maps\n\n![a|b](figures/one.png)\n\n## a|b\n")
    assert "| vapour | 25.0 % | 25 % |\n" in text and "| study | a\\|b |\n| --- | --- |\n" in text
    assert "| [a|b](walls.md) | a\\|b |" in text and "- a|b\n- one" in text
    assert text.endswith("## How to repeat it\n\n```sh\na|b\n```\n\n## a|b\n\na|b\n")
    assert (tmp_path / "figures" / "one.png").read_bytes() == PNG


def test_figures_have_their_size_on_paper() -> None:
    """145 px an inch; figures of two columns scroll on a phone, whatever their dots per inch."""
    for inches, dpi, wide in ((3.0, 300, False), (6.85, 300, True), (6.85, 150, True)):
        stream = io.BytesIO()
        Image.new("RGB", (round(inches * dpi), 40)).save(stream, format="PNG", dpi=(dpi, dpi))
        html = Page("x", [Figure(stream.getvalue(), "x")]).html()
        assert ('<div class="wide"' in html) is wide
        [width] = re.findall(r'<img alt="x" width="([0-9]+)"', html)
        assert int(width) == pytest.approx(145 * inches, abs=1)
