"""Pages of sections, paragraphs, tables and figures, written as HTML or as Markdown.

A page in HTML is one file: it needs no other file and no network, and can be read on a phone.
A page in Markdown refers to its figures as files beside it. All text is plain and gets escaped;
text in backticks is code in paragraphs and lists.
"""

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from string import Template

from matplotlib.figure import Figure as Drawn

from cldit.io.files import make_folder, read_text, write_bytes, write_text
from cldit.show.figures.style import DPI, png_of

_WIDE_IN = 5.5  # from which labels would be too small on a phone
_PX_PER_IN = 145  # a figure for two columns of a journal fills a page
_CODE = re.compile(r"`([^`]+)`")
_SLIDE = """<script>
(function (box) {
  var shots = box.querySelectorAll('figure'), range = box.querySelector('input');
  var label = box.querySelector('output'), texts = label.textContent.split('|');
  function show() {
    shots.forEach(function (shot, at) { shot.hidden = at !== Number(range.value); });
    label.textContent = texts[range.value];
    range.setAttribute('aria-valuetext', texts[range.value]);
  }
  box.querySelector('label').hidden = false;
  range.addEventListener('input', show);
  show();
})(document.currentScript.previousElementSibling);
</script>"""


@dataclass(frozen=True)
class Section:
    """Parts of a page under a heading of a level; omitted if all of them are empty.

    folded: only the title is visible in HTML, until a reader opens it.
    """

    title: str
    content: "Sequence[Block]"
    level: int = 2
    folded: bool = False


@dataclass(frozen=True)
class Figure:
    """A PNG image with its caption. file: its path relative to a page in Markdown. drawn: the
    figure of which it is, to be written in another format."""

    png: bytes
    caption: str
    file: str = ""
    drawn: Drawn | None = None

    @classmethod
    def of(cls, drawn: Drawn, caption: str, *, dpi: int = DPI, file: str = "") -> "Figure":
        """The image of a drawn figure."""
        return cls(png_of(drawn, dpi=dpi), caption, file, drawn)

    @property
    def width_in(self) -> float:
        """Width on paper, from the PNG's first chunk and its dots per metre if it has them."""
        width, at = int.from_bytes(self.png[16:20], "big"), self.png.find(b"pHYs", 0, 200) + 4
        dots_m = int.from_bytes(self.png[at : at + 4], "big") if at > 4 else _PX_PER_IN / 0.0254
        return width / (0.0254 * dots_m)


@dataclass(frozen=True)
class Slider:
    """Figures in turn, by a slider. Without JavaScript, and in Markdown, all of them in sequence.

    name: of the quantity that the slider changes. figures: by the text of its value.
    """

    name: str
    figures: Mapping[str, Figure]


@dataclass(frozen=True)
class Link:
    """A table cell that refers to another page of the same folder, named without its suffix."""

    label: str
    page: str


@dataclass(frozen=True)
class Bar:
    """A table cell that shows a share, 0 to 1, as the length of a bar."""

    share: float


Cell = str | Link | Bar


@dataclass(frozen=True)
class Table:
    """Rows of cells under titles, which may be empty; omitted without rows.

    numbers: columns that are aligned to the right; None: those of cells up to 16 letters.
    """

    titles: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    numbers: Sequence[int] | None = None

    @classmethod
    def pairs(cls, values: Mapping[str, str]) -> "Table":
        """Table of names and values, without titles."""
        return cls((), list(values.items()), numbers=())


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    lines: Sequence[str]


@dataclass(frozen=True)
class Code:
    """Lines of code or commands."""

    source: str


@dataclass(frozen=True)
class Html:
    """HTML that is inserted unchanged; omitted in Markdown."""

    source: str


Block = str | Section | Figure | Slider | Table | Bullets | Code | Html
"""A part of a page; a text is a paragraph."""


@dataclass(frozen=True)
class Page:
    """A page. heading: above its content; empty: the title. head: more HTML for its head."""

    title: str
    content: Sequence[Block]
    heading: str = ""
    head: str = ""

    def html(self) -> str:
        """The page as one HTML file."""
        return _template().substitute(
            title=escape(self.title),
            heading=escape(self.heading or self.title),
            head=self.head,
            body=html_of(self.content),
        )

    def markdown(self) -> str:
        """The page as Markdown."""
        return f"# {self.heading or self.title}\n\n{markdown_of(self.content)}\n"


def write_page(page: Page, path: Path) -> Path:
    """Writes a page as HTML or Markdown, by the suffix of `path`; returns the path.

    A file appears whole or not at all. The figures of a page in Markdown are written first.
    """
    if path.suffix == ".md":
        for figure in _figures(page.content):
            make_folder((path.parent / figure.file).parent)
            write_bytes(path.parent / figure.file, figure.png)
    write_text(path, page.markdown() if path.suffix == ".md" else page.html())
    return path


@cache
def _template() -> Template:
    return Template(read_text(Path(__file__).with_name("page.html")))


def _figures(content: Sequence[Block]) -> Iterator[Figure]:
    for part in content:
        match part:
            case Figure():
                yield part
            case Section(_, inner):
                yield from _figures(inner)
            case Slider(_, figures):
                yield from figures.values()


def html_of(content: Sequence[Block]) -> str:
    """HTML of parts of a page."""
    return "\n".join(html for part in content if (html := _html(part)))


def _html(part: Block) -> str:
    match part:
        case "" | Bullets([]) | Code(""):
            return ""
        case str():
            return f"<p>{_inline(part)}</p>"
        case Section(title, content, level, folded):
            body = html_of(content)
            heading = f"<h{level}>{escape(title)}</h{level}>\n" if title else ""
            if folded and body:
                return f"<details><summary>{heading}</summary>\n{body}\n</details>"
            return f"<section>{heading}\n{body}\n</section>" if body else ""
        case Figure(png, caption):
            wide = ' class="wide" tabindex="0"' if part.width_in > _WIDE_IN else ""
            size = f'width="{round(_PX_PER_IN * part.width_in)}"'
            source = f"data:image/png;base64,{b64encode(png).decode('ascii')}"
            return (
                f'<figure><div{wide}><img alt="{escape(caption)}" {size} src="{source}"></div>\n'
                f"<figcaption>{escape(caption)}</figcaption></figure>"
            )
        case Slider():
            return _html_slider(part)
        case Table():
            return _html_table(part)
        case Bullets(lines):
            items = "\n".join(f"<li>{_inline(line)}</li>" for line in lines)
            return f"<ul>\n{items}\n</ul>"
        case Code(text):
            return f'<pre tabindex="0">{escape(text)}</pre>'
        case Html(text):
            return text


def _inline(sentence: str) -> str:
    return _CODE.sub(r"<code>\1</code>", escape(sentence))


def _captioned(slider: Slider) -> list[Figure]:
    return [
        Figure(figure.png, f"{slider.name} at {value}. {figure.caption}".rstrip(), figure.file)
        for value, figure in slider.figures.items()
    ]


def _html_slider(slider: Slider) -> str:
    end, body = len(slider.figures) - 1, html_of(_captioned(slider))
    if end < 1:
        return body
    return (
        f'<div class="slider">\n<label hidden>{escape(slider.name)} '
        f"<output>{'|'.join(map(escape, slider.figures))}</output>\n"
        f'<input type="range" min="0" max="{end}" value="0" step="1"></label>\n'
        f"{body}\n</div>{_SLIDE}"
    )


def _html_table(table: Table) -> str:
    if not table.rows:
        return ""
    numbers = table.numbers
    if numbers is None:
        columns = enumerate(zip(*table.rows, strict=True))
        numbers = [at for at, cells in columns if max(map(_length, cells)) <= 16]
    lines = [[("td", cell) for cell in row] for row in table.rows]
    if table.titles:
        lines.insert(0, [("th" if title else "td", title) for title in table.titles])
    body = "\n".join(
        f"<tr>{''.join(_html_cell(*cell, at in numbers) for at, cell in enumerate(line))}</tr>"
        for line in lines
    )
    return f'<div class="scroll" tabindex="0"><table>\n{body}\n</table></div>'


def _html_cell(tag: str, cell: Cell, number: bool) -> str:
    attribute = ' class="n"' if number else ""
    match cell:
        case Bar(share):
            attribute = ' class="bar"'
            content = f'<span style="width:{100 * max(0.0, min(share, 1.0)):.1f}%"></span>'
        case Link(name, page):
            content = f'<a href="{escape(page)}.html">{escape(name)}</a>'
        case _:
            content = escape(cell)
    return f"<{tag}{attribute}>{content}</{tag}>"


def _length(cell: Cell) -> int:
    label = cell.label if isinstance(cell, Link) else cell
    return len(label) if isinstance(label, str) else 0


def markdown_of(content: Sequence[Block]) -> str:
    """Markdown of parts of a page."""
    return "\n\n".join(lines for part in content if (lines := _markdown(part)))


def _markdown(part: Block) -> str:
    match part:
        case str():
            return part
        case Section(title, content, level):
            body = markdown_of(content)
            return f"{'#' * level} {title}\n\n{body}" if body and title else body
        case Figure(_, caption, file):
            return f"![{caption}]({file})"
        case Slider():
            return markdown_of(_captioned(part))
        case Table(titles, rows):
            return _markdown_table(titles or [""] * len(rows[0]), rows) if rows else ""
        case Bullets(lines):
            return "\n".join(f"- {line}" for line in lines)
        case Code(text):
            return f"```sh\n{text}\n```" if text else ""
        case Html():
            return ""


def _markdown_table(titles: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(map(_markdown_cell, line))} |" for line in lines)


def _markdown_cell(cell: Cell) -> str:
    match cell:
        case Bar(share):
            return f"{100 * share:.0f} %"
        case Link(text, page):
            return f"[{text}]({page}.md)"
        case _:
            return cell.replace("|", r"\|")
