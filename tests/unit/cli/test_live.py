"""The figure of a recording in progress, and the command that shows it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cldit.acquisition import Plan
from cldit.acquisition.watch import Reading, Seen
from cldit.cli import main
from cldit.show.report.live import LastShot, live_figure, live_page

_META = {"shot": "b00_ref_00", "kind": "reference", "background_setpoint_K": 440.0,
         "saturation_counts": 16383, "time": "2026-01-01T00:00:00+00:00"}  # fmt: skip


def test_saturated_pixels_show_in_a_reduced_image(tiny_plan: Plan) -> None:
    """One of 1024 x 1280 is in the image, the histogram and the text."""
    image = np.full((1024, 1280), 1000, np.uint16)
    image[-1, 1] = 16383
    readings = tuple(Reading(60.0 * n, 470.0 + n, 480.0) for n in range(9))
    seen = Seen(state="recording", plan=tiny_plan, readings=readings)
    shot = LastShot(image, _META)
    drawn: Any = live_figure(seen, shot)
    shown, counts, whole, close = drawn.axes[:4]
    marked = np.ma.count(shown.images[1].get_array(), axis=1)
    assert marked[-1] == 1 and marked.sum() == 1
    assert counts.patches[1].get_data().values.tolist() == [1]
    assert whole.lines[0].get_ydata()[-1] == 478.0
    cut_K = 10.0 * tiny_plan.stability.tolerance_K
    assert close.lines[0].get_ydata()[0] == -min(10.0, cut_K)
    text = live_page(seen, shot, over=True, epoch_s=0.0)
    assert "7.6e-05 % of the pixels are saturated" in text and "highest 16383" in text


@pytest.mark.parametrize(
    "image", [np.zeros((1, 1)), np.full((2, 3, 500), 7), np.full((500, 3), 65535)]
)
def test_any_image_can_be_shown(image: np.ndarray[Any, Any]) -> None:
    page = live_page(Seen(state="recording"), LastShot(image.astype(np.uint16), _META),
                     over=False, epoch_s=0.0)  # fmt: skip
    assert "data:image/png" in page and "The recording has not begun." in page


def test_acquire_live(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(tiny_rig))
    (tmp_path / "plan.yaml").write_text(tiny_plan.dump())
    arguments = ["acquire", *(str(tmp_path / f"{n}.yaml") for n in ("rig", "plan")), "--live"]
    result = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path / "a")])
    assert result.exit_code == 0 and "10 of 10 shots" in result.output, result.output
    assert "page: " in result.output
    assert "finished" in (tmp_path / "a" / "live.html").read_text(encoding="utf-8")
