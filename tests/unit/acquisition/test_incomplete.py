"""Films that ended early: refused with the way out, or read as far as they go."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from cldit.acquisition.frames import FrameReader
from cldit.acquisition.pictures.source import Source
from cldit.errors import EvaluationError

FILM = np.random.default_rng(1).integers(0, 16000, (6, 20, 24)).astype(np.uint16)


def _pages(path: Path) -> None:
    with tifffile.TiffWriter(path) as file:
        for image in FILM:
            file.write(image, contiguous=False)


def _imagej(path: Path) -> None:
    tifffile.imwrite(path, FILM, imagej=True)


def _array(path: Path) -> None:
    np.save(path, FILM)


def _ome(path: Path) -> None:
    xml = tifffile.OmeXml()
    xml.addimage("uint16", (9, 20, 24), (9, 1, 1, 20, 24, 1), axes="TYX")  # three more elsewhere
    tifffile.imwrite(path, FILM, description=xml.tostring(), metadata=None)


@pytest.mark.parametrize(
    ("write", "name", "lost", "left"),
    [
        (_pages, "film.tif", 300, 5),
        (_imagej, "film.tif", 2000, 4),
        (_array, "film.npy", 1000, 4),
        (_ome, "film.ome.tif", 0, 6),
    ],
)
def test_what_is_there_is_read_on_request(
    write: object, name: str, lost: int, left: int, tmp_path: Path
) -> None:
    path = tmp_path / name
    assert callable(write)
    write(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - lost])
    reader = FrameReader()
    with pytest.raises(EvaluationError):
        stated = Source(path)
        [reader.read(stated, number) for number in range(len(FILM))]
    whole = Source(path, incomplete=True)
    assert len(reader.metadata(whole)) == left
    for number in range(left):
        np.testing.assert_array_equal(reader.read(whole, number), FILM[number])
    reader.close()
