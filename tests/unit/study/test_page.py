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
from cldit.show.figures.style import figure_of, png_of
from cldit.show.page import Figure
from cldit.study.page import (
    AGREES,
    DISAGREES,
    OPEN,
    StudyPage,
    Verdict,
    write_overview,
    write_page,
)


@pytest.mark.parametrize(
    ("value", "error", "low", "high", "word", "allowed"),
    [
        (0.99, 0.0, None, 1.0, AGREES, "at most 1 K"),
        (1.01, 0.0, None, 1.0, DISAGREES, "at most 1 K"),
        (-9.0, 0.4, -10.0, 10.0, AGREES, "±10 K"),
        (-9.0, 0.6, -10.0, 10.0, OPEN, "±10 K"),
        (-11.0, 0.6, -10.0, 10.0, OPEN, "±10 K"),
        (-11.0, 0.4, -10.0, 10.0, DISAGREES, "±10 K"),
        (30.0, 6.0, 20.0, 40.0, OPEN, "20 to 40 K"),
        (30.0, 4.0, 20.0, 40.0, AGREES, "20 to 40 K"),
        (30.0, 0.0, 31.0, None, DISAGREES, "at least 31 K"),
        (30.0, math.nan, 31.0, None, OPEN, "at least 31 K"),
        (math.nan, 0.0, None, None, OPEN, "at least 0 K"),
        (math.inf, 0.0, 1.0, None, OPEN, "at least 1 K"),
    ],
)
def test_verdict(
    value: float, error: float, low: float | None, high: float | None, word: str, allowed: str
) -> None:
    """Twice the error must not reach across a limit."""
    verdict = Verdict(claim="x", value=value, error=error, unit="K", low=low, high=high)
    assert (verdict.word, verdict.allowed) == (word, allowed)


@pytest.mark.parametrize(
    ("value", "error", "found"),
    [(3.14159, 0.0, "3.14 K"), (3.14159, 0.043, "3.142 ± 0.043 K"), (251.0, 12.0, "251 ± 12 K")],
)
def test_value_has_the_digits_of_its_error(value: float, error: float, found: str) -> None:
    assert Verdict(claim="x", value=value, error=error, unit="K").found == found


def _page() -> StudyPage:
    figure = figure_of(1.0, 1.0)
    figure.subplots().plot([0, 1])
    return StudyPage(
        name="walls",
        title="Wall <temperature>",
        command="cldit study walls --quick",
        text="One & only paragraph.",
        figures={"maps": Figure(png_of(figure), "caption", "study-walls-maps.png")},
        table=[{"case": "a|b", "T_app / K": 400.123456}, {"case": "c", "T_app / K": math.nan}],
        verdicts=(
            Verdict(claim="good", value=0.5, unit="K", high=1.0, reason="never shown"),
            Verdict(claim="bad", value=2.0, unit="K", high=1.0, reason="for a reason"),
        ),
        scenes={"gdi": load_scene("gdi-cone")},
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
    assert [each["verdict"] for each in told["verdicts"]] == [AGREES, DISAGREES]
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
    assert "Against the paper" not in page.page().html()
