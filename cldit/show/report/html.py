"""One self-contained report.html: no other file, no network, readable on a phone."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from cldit.io.files import write_text

_PAGES = Environment(
    loader=PackageLoader("cldit.show.report", ""),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)
_WIDE_PX = 1100  # a map with its key has some 1050
_WIDE = 1.8  # width over height of two panels


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

    @property
    def base64(self) -> str:
        """The PNG as text, for a page that holds it."""
        return b64encode(self.png).decode("ascii")


Table = tuple[list[str], list[list[str]]]  # titles, lines


@dataclass(frozen=True, kw_only=True)
class EvaluationContent:
    """What a page shows of an evaluation.

    remarks: a line each. findings: what witnesses name, a line each. witnesses, drifts: in kelvin
    by background. drift_axis: over what a drift is told. others: witnesses without kelvin. budget:
    medians by part. pictures: its maps.
    """

    remarks: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    witnesses: Table = ([], [])
    others: tuple[str, ...] = ()
    improbable: str = ""
    drifts: Table = ([], [])
    drift_axis: str = ""
    budget: Table = ([], [])
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ReportContent:
    """Everything that the report shows; text is plain and gets escaped.

    maps: stand first.
    camera: (background in K, picture of what the camera saw), for the slider.
    shares: mean share of the signal by origin, 0 to 1; share_pictures go with it.
    evaluation: witnesses, drift terms and budget of the shots.
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
    evaluation: EvaluationContent = EvaluationContent()
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
    write_text(path, report_html(content))


def report_html(content: ReportContent) -> str:
    """The report as text; sections without content are left out."""
    return render("run.html", run=content)


def render(template: str, **values: Any) -> str:
    """A whole page from a template beside this file; values that are plain text get escaped."""
    return _PAGES.get_template(template).render(values)
