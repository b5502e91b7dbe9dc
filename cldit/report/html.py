"""One self-contained report.html: no other file, no network, readable on a phone."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from cldit.images import fsync_folder

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#1b1b1b;background:#fff;margin:0 auto;
max-width:62rem;padding:0 1rem 3rem}
h1{font-size:1.6rem;margin:1.2rem 0 .2rem}h2{font-size:1.2rem;margin:2rem 0 .5rem}
figure{margin:0 0 1.2rem}img{max-width:100%;height:auto;display:block;margin:auto}
figcaption{color:#444;font-size:.92rem}
table{border-collapse:collapse;margin:.4rem 0}
td,th{padding:.2rem .9rem .2rem 0;text-align:left;vertical-align:top;
border-bottom:1px solid #ddd;font-weight:normal;overflow-wrap:anywhere}
th,td:first-child{overflow-wrap:break-word}td:not(.n){min-width:5rem}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}td.n{white-space:nowrap}
td.bar{width:40%;min-width:4rem}
td.bar span{display:block;background:#3a6ea5;height:.8rem;min-width:1px}
pre{background:#f5f5f5;padding:.8rem;overflow:auto;font-size:.85rem}
input[type=range]{width:100%;height:2rem}output{font-weight:bold}summary{cursor:pointer}
.scroll{overflow-x:auto}
@media(max-width:40rem){.wide{overflow-x:auto}.wide img{max-width:none;width:50rem}}
"""

# Without JavaScript all pictures of a slider are shown, one below the other.
_SCRIPT = """
document.querySelectorAll('.slider').forEach(function (box) {
  var shots = box.querySelectorAll('figure'), range = box.querySelector('input');
  if (!range) return;
  var label = box.querySelector('output'), texts = label.textContent.split('|');
  function show() {
    shots.forEach(function (shot, at) { shot.hidden = at !== Number(range.value); });
    label.textContent = texts[range.value];
    range.setAttribute('aria-valuetext', texts[range.value]);
  }
  box.querySelector('label').hidden = false;
  range.addEventListener('input', show);
  show();
});
"""


_WIDE_PX = 1100  # a map with its key has some 1050
_WIDE = 1.8  # width over height of two panels
_SHORT = 16  # characters of a table's cell that stay on one line


@dataclass(frozen=True)
class Picture:
    """A PNG with the text that stands below it."""

    png: bytes
    caption: str

    @property
    def wide(self) -> bool:
        """Whether labels of several panels would be too small on a phone: there it scrolls."""
        width, height = (int.from_bytes(self.png[at : at + 4], "big") for at in (16, 20))
        return width > _WIDE_PX or width > _WIDE * height  # of the PNG's first chunk


@dataclass(frozen=True, kw_only=True)
class ReportContent:
    """Everything that the report shows; text is plain and gets escaped.

    maps: stand first.
    camera: (background in K, picture of what the camera saw), for the slider.
    shares: mean share of the signal by origin, 0 to 1; share_pictures go with it.
    reasons: number of pixels by why they have no value.
    figures: of the spray, name -> value with unit; trace: of the trace.
    stages: (name, seconds) in the order they ran.
    notes: stage -> text beside its time, for instance which code was compiled.
    commands: that do it again, in the run's folder.
    """

    name: str
    description: str = ""
    maps: tuple[Picture, ...] = ()
    camera: tuple[tuple[float, Picture], ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)
    share_pictures: tuple[Picture, ...] = ()
    more_pictures: tuple[Picture, ...] = ()
    reasons: Mapping[str, int] = field(default_factory=dict)
    figures: Mapping[str, str] = field(default_factory=dict)
    trace: Mapping[str, str] = field(default_factory=dict)
    stages: tuple[tuple[str, float], ...] = ()
    notes: Mapping[str, str] = field(default_factory=dict)
    device: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    commands: tuple[str, ...] = ()
    scene_yaml: str = ""


def write_report(path: Path, content: ReportContent) -> None:
    """Writes the report of `content` to `path`; the file appears whole or not at all."""
    part = path.with_name(path.name + ".part")
    with part.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(report_html(content))
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(path)
    fsync_folder(path.parent)


def report_html(content: ReportContent) -> str:
    """The report as text; sections without content are left out."""
    sections = [
        ("Emissivity and apparent temperature", figures_html(content.maps)),
        ("What the camera saw", _slider(content.camera)),
        (
            "Where the signal comes from",
            figures_html(content.share_pictures) + _shares(content.shares),
        ),
        ("Errors and weights", figures_html(content.more_pictures)),
        ("Pixels", _counts(content.reasons)),
        ("Spray", _table(content.figures)),
        ("Trace", _table(content.trace)),
        ("Run times", _stages(content.stages, content.notes)),
        ("Computed with", _versions(content)),
        ("To repeat it", _commands(content.commands) + _scene(content.scene_yaml)),
    ]
    intro = f"<p>{escape(content.description)}</p>\n" if content.description else ""
    return document(content.name, intro, sections)


def document(title: str, intro: str, sections: Sequence[tuple[str, str]]) -> str:
    """HTML of a whole page.

    Args:
        title: plain text.
        intro: HTML.
        sections: heading and HTML; those without content are left out.
    """
    name = escape(title)
    body = "".join(_section(heading, content) for heading, content in sections)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name} – DIT</title>\n<style>{_STYLE}</style></head>\n<body>\n"
        f"<h1>{name}</h1>\n{intro}\n{body}"
        f"<script>{_SCRIPT}</script>\n</body></html>\n"
    )


def _section(title: str, body: str) -> str:
    heading = f"<h2>{escape(title)}</h2>\n" if title else ""
    return f"<section>{heading}{body}</section>\n" if body else ""


def _figure(picture: Picture) -> str:
    data = base64.b64encode(picture.png).decode("ascii")
    caption = escape(picture.caption)
    wide = ' class="wide"' if picture.wide else ""
    return (
        f'<figure><div{wide}><img alt="{caption}" src="data:image/png;base64,{data}"></div>\n'
        f"<figcaption>{caption}</figcaption></figure>\n"
    )


def figures_html(pictures: tuple[Picture, ...]) -> str:
    """Pictures with their captions, inside the page."""
    return "".join(_figure(picture) for picture in pictures)


def _slider(camera: tuple[tuple[float, Picture], ...]) -> str:
    if not camera:
        return ""
    shots = "".join(
        _figure(
            Picture(picture.png, f"Background at {background_K:g} K. {picture.caption}".strip())
        )
        for background_K, picture in camera
    )
    labels = "|".join(f"{background_K:g} K" for background_K, _ in camera)
    control = (
        f"<label hidden>Background <output>{labels}</output>\n"
        f'<input type="range" min="0" max="{len(camera) - 1}" value="0" step="1"></label>\n'
    )
    return f'<div class="slider">\n{control if len(camera) > 1 else ""}{shots}</div>\n'


def _row(*cells: str) -> str:
    return f"<tr>{''.join(cells)}</tr>\n"


def _cell(text: str) -> str:
    return f"<td>{escape(text)}</td>"


def _number(text: str) -> str:
    return f'<td class="n">{escape(text)}</td>'


def _bar(share: float) -> str:
    return (
        f'<td class="bar"><span style="width:{100 * min(max(share, 0.0), 1.0):.1f}%"></span></td>'
    )


def _rows(rows: list[str]) -> str:
    return f'<div class="scroll"><table>\n{"".join(rows)}</table></div>\n' if rows else ""


def table_html(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """HTML of `rows` of texts below `titles`; columns of short ones, as numbers, do not break."""
    short = [all(len(row[at]) <= _SHORT for row in rows) for at in range(len(titles))]
    kinds = [' class="n"' if each else "" for each in short]
    head = _row(*(f"<th{k}>{escape(title)}</th>" for k, title in zip(kinds, titles, strict=True)))

    def line(row: Sequence[str]) -> str:
        return _row(*(_number(c) if s else _cell(c) for c, s in zip(row, short, strict=True)))

    return _rows([head, *map(line, rows)]) if rows else ""


def _table(values: Mapping[str, str]) -> str:
    return _rows([_row(_cell(name), _cell(value)) for name, value in values.items()])


def _shares(shares: Mapping[str, float]) -> str:
    return "<p>Mean over the pixels where the spray is:</p>\n" * bool(shares) + _rows(
        [
            _row(_cell(name), _number(f"{100 * share:.1f} %"), _bar(share))
            for name, share in shares.items()
        ]
    )


def _counts(reasons: Mapping[str, int]) -> str:
    total = max(sum(reasons.values()), 1)
    return _rows(
        [
            _row(_cell(name), _number(str(count)), _number(f"{100 * count / total:.1f} %"))
            for name, count in reasons.items()
        ]
    )


def _stages(stages: tuple[tuple[str, float], ...], notes: Mapping[str, str]) -> str:
    total = sum(seconds for _, seconds in stages)
    rows = [
        _row(
            _cell(name),
            _number(f"{seconds:.2f} s"),
            _bar(seconds / total if total > 0 else 0.0),
            _cell(notes.get(name, "")),
        )
        for name, seconds in stages
    ]
    if rows:
        rows.append(_row(_cell("all"), _number(f"{total:.2f} s"), _cell(""), _cell("")))
    return _rows(rows)


def _versions(content: ReportContent) -> str:
    device = {"device": content.device} if content.device else {}
    return _table({**device, **content.versions})


def _commands(lines: tuple[str, ...]) -> str:
    return f"<pre>{escape(chr(10).join(lines))}</pre>\n" if lines else ""


def _scene(text: str) -> str:
    if not text:
        return ""
    return (
        "<details open><summary>scene.yaml, with every default</summary>"
        f"<pre>{escape(text)}</pre></details>\n"
    )
