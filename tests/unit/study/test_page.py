"""Verdicts follow their numbers; pages hold all they show and need nothing else."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import pytest

from cldit.errors import StudyError
from cldit.scene import load_scene
from cldit.show.figures.sheet import figure_of
from cldit.show.page import Figure
from cldit.study.figures import small_png
from cldit.study.page import StudyPage, Verdict, summary, write_overview, write_page


@pytest.mark.parametrize(
    ("value", "low", "high", "agrees", "allowed"),
    [
        (0.99, None, 1.0, True, "at most 1 K"),
        (1.01, None, 1.0, False, "at most 1 K"),
        (-9.0, -10.0, 10.0, True, "±10 K"),
        (-11.0, -10.0, 10.0, False, "±10 K"),
        (30.0, 20.0, 40.0, True, "20 to 40 K"),
        (30.0, 31.0, None, False, "at least 31 K"),
        (math.nan, None, None, False, "at least 0 K"),
        (math.inf, 1.0, None, False, "at least 1 K"),
    ],
)
def test_verdict(
    value: float, low: float | None, high: float | None, agrees: bool, allowed: str
) -> None:
    verdict = Verdict(claim="x", value=value, unit="K", low=low, high=high)
    assert (verdict.agrees, verdict.allowed) == (agrees, allowed)
    assert verdict.word == ("agrees" if agrees else "disagrees")


def _page() -> StudyPage:
    figure = figure_of(1.0, 1.0)
    figure.subplots().plot([0, 1])
    return StudyPage(
        name="walls",
        title="Wall <temperature>",
        command="cldit study walls --quick",
        text="One & only paragraph.",
        figures={"maps": Figure(small_png(figure), "caption")},
        table=[{"case": "a|b", "T_app / K": 400.123456}, {"case": "c", "T_app / K": math.nan}],
        verdicts=(
            Verdict(claim="good", value=0.5, unit="K", high=1.0, why="never shown"),
            Verdict(claim="bad", value=2.0, unit="K", high=1.0, why="for a reason"),
        ),
        scenes={"gdi": load_scene("gdi")},
        quick=True,
    )


def test_page_is_whole(tmp_path: Path) -> None:
    """HTML with its pictures inside, Markdown beside them, numbers as CSV and JSON."""
    page = _page()
    written = write_page(page, tmp_path)
    html = written.read_text(encoding="utf-8")
    assert "Wall &lt;temperature&gt;" in html and "One &amp; only" in html
    assert "data:image/png;base64," in html and "viewport" in html
    assert not re.search(r"(src|href)=\"(?!data:)", html), "refers to something outside"
    assert "for a reason" in html and "never shown" not in html
    assert "1 of 2 statements agree." in html and "--quick" in html
    markdown = (tmp_path / "walls.md").read_text(encoding="utf-8")
    (picture,) = re.findall(r"!\[caption\]\((.*)\)", markdown)
    assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    assert r"a\|b" in markdown
    rows = list(csv.DictReader((tmp_path / "walls.csv").read_text(encoding="utf-8").splitlines()))
    assert float(rows[0]["T_app / K"]) == 400.123456
    told = json.loads((tmp_path / "walls.json").read_text(encoding="utf-8"))
    assert [each["agrees"] for each in told["verdicts"]] == [True, False]
    assert load_scene(tmp_path / "scenes" / "walls-gdi.yaml") == page.scenes["gdi"]
    assert told["table"][1]["T_app / K"] is None  # NaN is no JSON
    index = write_overview(tmp_path, ["methane", "walls"]).read_text(encoding="utf-8")
    assert 'href="walls.html"' in index and "methane" not in index
    assert "1 of 2 statements agree." in (tmp_path / "overview.md").read_text(encoding="utf-8")


def test_markdown_alone(tmp_path: Path) -> None:
    assert write_page(_page(), tmp_path, markdown_only=True).name == "walls.md"
    write_overview(tmp_path, ["walls"], markdown_only=True)
    assert {path.suffix for path in tmp_path.iterdir()} == {".md", ".json", ".png"}
    (tmp_path / "walls.json").write_text("{")
    with pytest.raises(StudyError, match="is damaged"):
        write_overview(tmp_path, ["walls"])


def test_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StudyError, match="cannot be written"):
        write_page(_page(), tmp_path / "file")


def test_without_verdicts() -> None:
    page = StudyPage(name="n", title="t", figure="f", text="", figures={}, table=())
    assert "Against the paper" not in page.html().html()
    assert summary(()) == "All 0 statements agree."
