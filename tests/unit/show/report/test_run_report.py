"""The report of a run is read from top to bottom: results first, details folded."""

from __future__ import annotations

import re
import shutil
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

from cldit.radiance.weights import Weights
from cldit.run import open_run
from cldit.show.figures.maps import shares_of_light
from cldit.show.report.run_report import write_run_report

RUN = Path(__file__).parents[3] / "data" / "run-0.1.0"
_LONGEST_PX = 6000
_WIDE_PX, _LINE_PX = 960, 36  # of the page's text; a line of a table or paragraph, with its margins


def visible_px(html: str) -> float:
    """Height of a page whose details are folded, of which a slider shows the first figure."""
    shown = re.sub(r"<details>.*?</details>", "<p>title</p>", html, flags=re.DOTALL)
    shown = re.sub(r'(<div class="slider">.*?</figure>).*?</script>', r"\1", shown, flags=re.DOTALL)
    height = 0.0
    for width, data in re.findall(r'width="(\d+)" src="data:image/png;base64,([^"]{32})', shown):
        columns, rows = _size(data)
        height += min(int(width), _WIDE_PX) * rows / columns
    lines = len(re.findall(r"<(?:tr|p|li|figcaption|h\d)\b", shown)) + shown.count("\n\n")
    return height + _LINE_PX * lines


def _size(data: str) -> tuple[int, int]:
    """Columns and rows of a PNG, whose first bytes are in base64."""
    head = b64decode(data)
    return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("report") / "run"
    shutil.copytree(RUN, folder)
    return write_run_report(open_run(folder)).read_text(encoding="utf-8")


def test_details_are_folded(html: str) -> None:
    assert 1000 < visible_px(html) < _LONGEST_PX
    folded = re.findall(r"<summary><h2>(.*?)</h2>", html)
    assert {"Spray", "Trace", "Run times", "Computed with", "Pixels"} <= set(folded)
    assert "<details open" not in html and "temperatures_K:" not in html  # nor the scene's YAML


def test_the_result_is_under_the_figure(html: str) -> None:
    caption = re.search(r"<figcaption>(.*?)</figcaption>", html)
    assert caption is not None
    assert re.search(r"\d+ to \d+ K in \d+ of \d+ pixels", caption[1])


def test_a_share_that_is_nowhere_visible_has_no_panel() -> None:
    """Here the droplets send 1 % of the vapour's light: all of their panel would be black."""
    ones = np.ones((2, 3), np.float32)
    weights = Weights(0.0 * ones, 0.0 * ones, ones, 0.01 * ones)
    bare = Weights(ones, 0.0 * ones, 0.0 * ones, 0.0 * ones)
    panels, _ = shares_of_light(weights, bare, background=1.0, wall=1.0, patches={})
    assert [panel.title for panel in panels] == ["share of vapour in the signal"]
