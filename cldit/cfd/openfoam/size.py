"""How large a time of an OpenFOAM case is, told from the heads of its files."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

from cldit.cfd.inputs import regular
from cldit.cfd.openfoam.file import find_foam
from cldit.cfd.size import Size
from cldit.errors import SprayError

_HEAD = 10_000
_NOTE = re.compile(rb"nPoints:\s*(\d+)\s+nCells:\s*(\d+)\s+nFaces:\s*(\d+)")
_COUNT = re.compile(rb"^\s*(\d+)\s*\(", re.MULTILINE)
_PACKED = 4  # bytes of a file that one of its .gz stands for


def foam_size(meshes: Sequence[Path], *, fields: int) -> Size:
    """What the meshes of all processors take.

    Args:
        meshes: folder of each processor's mesh.
        fields: cell fields that are read.
    """
    total, largest, held = 0, 0.0, 0.0
    for folder in meshes:
        points, cells, faces = _counts(folder / "owner")
        # a face: four corners, where it begins, two cells, and its sides; a cell: where it begins
        held += 24 * points + (4 * 4 + 4 + 8 + 8) * faces + (8 + 8 * fields) * cells
        largest = max(largest, _stored(folder / "faces"))
        total += cells
    return Size(total, 0, held + 1.5 * largest)


def _stored(path: Path) -> float:
    found = find_foam(path)
    return 0.0 if found is None else found.stat().st_size * (_PACKED if found != path else 1)


def _counts(owner: Path) -> tuple[int, int, int]:
    """Points, cells and faces, by the note that OpenFOAM leaves in the file, or by its list."""
    found = find_foam(owner)
    if found is None:
        return 0, 0, 0
    try:
        plain = regular(found)
        with gzip.open(plain) if found != owner else plain.open("rb") as stream:
            head = stream.read(_HEAD)
    except (
        SprayError,
        OSError,
        EOFError,
        zlib.error,
    ):  # who reads the file says what is wrong with it
        return 0, 0, 0
    note = _NOTE.search(head)
    if note is not None:
        points, cells, faces = map(int, note.groups())
        return points, cells, faces
    count = _COUNT.search(head)
    faces = 0 if count is None else int(count.group(1))
    return faces // 3, faces // 3, faces
