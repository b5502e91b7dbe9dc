"""Images on disk: the size of a pixel as ImageJ reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from cldit.errors import RunFolderError
from cldit.io.images import read_image, write_image


def test_resolution_is_pixels_per_mm_across_and_up(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    write_image(path, np.zeros((2, 3), np.float32), name="a", unit="1", pixel_m=(5e-4, 2e-3))
    with tifffile.TiffFile(path) as file:
        tags = file.pages.first.tags
        across, up = (tags[name].value for name in ("XResolution", "YResolution"))
    assert across[0] / across[1] == pytest.approx(2.0)
    assert up[0] / up[1] == pytest.approx(0.5)


def test_an_error_without_a_text_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As memory that does not suffice."""

    def fails(*_: object, **__: object) -> None:
        raise MemoryError

    (tmp_path / "a.tif").write_bytes(b"II*\0")
    monkeypatch.setattr("cldit.io.images.tifffile.TiffFile", fails)
    with pytest.raises(RunFolderError, match=r"cannot be read as TIFF \(MemoryError\)"):
        read_image(tmp_path / "a.tif")
