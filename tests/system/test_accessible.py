"""Pages by axe-core in Chromium: contrast, names, alternative texts, order of headings.

Skipped without Chromium, playwright or axe-core, which `npm install axe-core` puts into
`node_modules` of some folder; the variable AXE names its `axe.min.js`.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from cldit.acquisition import Plan, acquire
from cldit.cli.live import PAGE, write_pages
from cldit.rig.load import open_rig
from cldit.run import open_run
from cldit.scene import load_scene
from cldit.show.figures.style import figure_of, png_of
from cldit.show.page import (
    Bar,
    Block,
    Code,
    Figure,
    Page,
    Section,
    Slider,
    Table,
    write_page,
)
from cldit.show.report.run_report import write_run_report
from cldit.study.page import StudyPage, Verdict, write_overview
from cldit.study.page import write_page as write_study
from tests.viewed import Viewer, made_run, open_page, scene_for

RUN = Path(__file__).parents[1] / "data" / "run-0.1.0"
# best practices of axe beyond WCAG 2.2 AA are checked too
ALLOWED: set[str] = set()


@pytest.fixture(scope="module")
def axe() -> str:
    """Script of axe-core; skips without it."""
    place = Path(os.environ.get("AXE", "node_modules/axe-core/axe.min.js"))
    if not place.is_file():
        pytest.skip(f"no axe-core here ({place}; AXE names it)")
    return place.read_text(encoding="utf-8")


def found(viewer: Viewer, axe: str) -> list[str]:
    """Violations on the open page: rule, elements, and what axe says of the first."""
    viewer.run(axe)
    said: list[dict[str, Any]] = viewer.run("axe.run().then((one) => one.violations)")
    return [
        f"{one['id']}: {[node['target'] for node in one['nodes'][:4]]} "
        f"{one['nodes'][0]['failureSummary']}"
        for one in said
        if one["id"] not in ALLOWED
    ]


def report(folder: Path) -> Path:
    """The report of a run."""
    shutil.copytree(RUN, folder / "run")
    return write_run_report(open_run(folder / "run"))


def a_line() -> Figure:
    figure = figure_of(2.0, 1.0)
    figure.subplots().plot([0.0, 1.0])
    return Figure(png_of(figure, dpi=50), "a line", "line.png")


def study(folder: Path) -> Path:
    """A study, with verdicts, figures and a table."""
    page = StudyPage(
        name="sizes",
        title="Sizes of droplets",
        about="Droplets.",
        command="cldit study sizes",
        verdicts=(Verdict(claim="claim", value=1.0, error=0.1, unit="K", low=0.0, high=2.0),),
        figures={"maps": a_line()},
        table=[{"case": "one", "T_app / K": 400.0}],
        scenes={"gdi": load_scene("gdi-cone")},
    )
    write_study(page, folder)
    return folder / "sizes.html"


def overview(folder: Path) -> Path:
    """The overview of the studies."""
    study(folder)
    write_overview(folder, ["sizes"])
    return folder / "overview.html"


def parts(folder: Path) -> Path:
    """All other parts of pages."""
    content: list[Block] = [
        Section("Slider", [Slider("Background", {"400 K": a_line(), "500 K": a_line()})]),
        Section("Table", [Table(("name", "share"), [["one", Bar(0.4)]])]),
        Section("scene.yaml", [Code("name: a\n" * 90)], folded=True),
        Code("cldit run gdi " + "--set walls.temperature_K=500 " * 9),
    ]
    return write_page(Page("All parts", content), folder / "parts.html")


@pytest.mark.parametrize("write", [report, study, overview, parts])
def test_pages_are_accessible(viewer: Viewer, axe: str, tmp_path: Path, write: Any) -> None:
    viewer.page.goto(write(tmp_path).as_uri())
    assert found(viewer, axe) == []


def test_the_live_page_is_accessible(
    viewer: Viewer, axe: str, tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a")
    ended = Event()
    ended.set()
    write_pages(tmp_path / "a", ended)
    viewer.page.goto((tmp_path / "a" / PAGE).as_uri())
    assert found(viewer, axe) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_viewer_is_accessible(viewer: Viewer, axe: str, tmp_path: Path, scheme: Any) -> None:
    viewer.page.emulate_media(color_scheme=scheme)
    open_page(viewer, tmp_path, made_run(scene_for()), made_run(scene_for(name="other")))
    viewer.page.select_option("#other", "1")
    viewer.set({"wall_K": 500.0})
    assert found(viewer, axe) == []
