"""Page of scenes: an image, a command, seconds and the stated error of each."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from cldit.errors import ClditError
from tests.bench.gallery import main


def test_a_gallery(tmp_path: Path) -> None:
    main(["empty", "--pixels", "24", "--out", str(tmp_path)])
    page = (tmp_path / "gallery.md").read_text(encoding="utf-8")
    assert "## empty\n" in page and "\ncldit run empty --quick --pixels 24 --trace-only\n" in page
    assert " core-s; error of T_app: " in page and "(gallery/empty.png)" in page
    with Image.open(tmp_path / "gallery" / "empty.png") as picture:
        assert picture.width > 300


def test_an_unknown_scene_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(ClditError, match="nosuch"):
        main(["empty", "nosuch", "--out", str(tmp_path / "g")])
    assert not (tmp_path / "g").exists()
