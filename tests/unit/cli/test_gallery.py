"""`cldit gallery`: a page with a picture, a command, seconds and the stated error of each scene."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner
from PIL import Image

from cldit.cli import main


def test_a_gallery(tmp_path: Path) -> None:
    words = ["gallery", "empty", "--pixels", "24", "--out", str(tmp_path)]
    done = CliRunner().invoke(main, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "gallery.md").read_text(encoding="utf-8")
    assert "## empty\n" in page and "\ncldit run empty --quick --pixels 24 --trace-only\n" in page
    assert " core-s; error of T_app: " in page and "(gallery/empty.png)" in page
    with Image.open(tmp_path / "gallery" / "empty.png") as picture:
        assert picture.width > 300


def test_an_unknown_scene_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["gallery", "empty", "nosuch", "--out", str(tmp_path / "g")])
    assert done.exit_code == 1 and "nosuch" in done.output
    assert not (tmp_path / "g").exists()
