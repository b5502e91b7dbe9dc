"""The live view in the terminal: an image of characters, and never a delay."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cldit.acquisition import Plan, SavedShot, acquire, open_acquisition
from cldit.acquisition.plan import Shot
from cldit.acquisition.progress import Progress
from cldit.cli import live, main
from cldit.cli.live import LiveView, half_blocks
from cldit.rig.load import open_rig
from cldit.show.report.live import stretched


def ramp(shape: tuple[int, int] = (48, 64)) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """Bright at the lower right."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.asarray(1000 + 50 * (x + y), np.uint16)


def colours(text: Any) -> list[tuple[int, ...]]:
    styles = [str(span.style) for span in text.spans]
    return [
        tuple(int(part) for part in half[4:-1].split(","))
        for style in styles for half in style.split(" on ")
    ]  # fmt: skip


def test_half_blocks_show_the_picture() -> None:
    """Upright, as wide as asked for, twice as many pixels as characters in height."""
    text = half_blocks(ramp(), 32)
    lines = text.plain.splitlines()
    assert len(lines) == 12 and {len(line) for line in lines} == {32}
    shades = [sum(colour) for colour in colours(text)]
    assert len(shades) == 2 * 12 * 32
    assert shades[0] == min(shades) and shades[-1] == max(shades)
    top_right, bottom_left = shades[2 * 31], shades[2 * 11 * 32 + 1]
    assert shades[0] < min(top_right, bottom_left) and max(top_right, bottom_left) < shades[-1]


@pytest.mark.parametrize(
    "image", [np.zeros((1, 1)), np.full((3, 500), 7), np.full((500, 3), 65535)]
)
def test_any_picture_can_be_shown(image: np.ndarray[Any, Any]) -> None:
    counts = image.astype(np.uint16)
    assert np.all(stretched(counts)[0] == 0.0)
    assert half_blocks(counts).plain


def saved(image: np.ndarray[Any, np.dtype[np.uint16]]) -> SavedShot:
    shot = Shot("b00_ref_00", 0, 440.0, "reference", 0)
    return SavedShot(shot, image, {"saturated_percent": 0.0, "saturation_counts": 16383})


def test_the_last_image_is_shown() -> None:
    with LiveView() as view:
        view.watch(Progress("preflight", 0, 10, None))
        end = time.monotonic() + 30.0
        while "b00_ref_00" not in view._image.plain:
            assert time.monotonic() < end
            view.show(saved(ramp((512, 640))))
            time.sleep(0.01)
    assert "440 K reference" in view._image.plain


def test_slow_view_drops_pictures_and_delays_nothing(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal that needs a second for each picture gets the first and a late one of twenty."""
    shown: list[str] = []

    def slow(view: LiveView, newest: SavedShot) -> None:
        shown.append(newest.shot.id)
        time.sleep(1.0)

    monkeypatch.setattr(LiveView, "show", slow)
    plan = tiny_plan.model_copy(update={"shots": 8})
    with LiveView() as view:
        begin = time.monotonic()
        assert acquire(
            open_rig(tiny_rig), plan, tmp_path / "a", progress=view.watch, preview=view.show
        ).complete
        took_s = time.monotonic() - begin
    assert len(shown) < 20 and took_s < 20.0
    assert len(open_acquisition(tmp_path / "a").shots) == 20


def test_acquire_live(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(tiny_rig))
    (tmp_path / "plan.yaml").write_text(tiny_plan.dump())
    pictures = []

    def counted(*arguments: Any) -> Any:
        pictures.append(arguments)
        return half_blocks(*arguments)

    monkeypatch.setattr(live, "half_blocks", counted)
    arguments = ["acquire", *(str(tmp_path / f"{n}.yaml") for n in ("rig", "plan")), "--live"]
    result = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path / "a")])
    assert result.exit_code == 0 and "10 of 10 shots" in result.output, result.output
    assert pictures
    assert "page: " in result.output
    assert "finished" in (tmp_path / "a" / "live.html").read_text(encoding="utf-8")
