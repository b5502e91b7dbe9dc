"""How large what a vtk file holds is, told from its head."""

from __future__ import annotations

import re
from pathlib import Path

from cldit.cfd.size import Size

_PIECE = re.compile(rb"<Piece\b[^>]*>")
_COUNT = re.compile(rb'\bNumberOf(Points|Cells)\s*=\s*["\'](\d+)["\']')
_AT_ONCE = 1 << 20
_WHILE_READING = 1.4  # bytes that vtk takes at its peak for one of the file's


def piece_counts(file: Path) -> tuple[int, int]:
    """Points and cells of all pieces of a .vtu or .vtp file.

    The file is read as far as its arrays; where they lie between the pieces, to its end.
    """
    points = cells = 0
    rest = b""
    with file.open("rb") as stream:
        while part := stream.read(_AT_ONCE):
            text = rest + part
            ends = text.find(b"<AppendedData")
            last = 0
            for piece in _PIECE.finditer(text if ends < 0 else text[:ends]):
                found = {name: int(count) for name, count in _COUNT.findall(piece.group())}
                points += found.get(b"Points", 0)
                cells += found.get(b"Cells", 0)
                last = piece.end()
            if ends >= 0:
                break
            rest = text[max(last, len(text) - 1000) :]
    return points, cells


def vtk_size(file: Path, *, fields: int) -> Size:
    """What the mesh or cloud in `file` takes with `fields` fields.

    Cells are taken for hexahedra where that is not told.
    """
    stored = file.stat().st_size
    if file.suffix == ".vtk":  # binary: nine integers a cell that become nine of twice the size
        return Size(stored // 70, 0, 2.0 * stored)
    points, cells = piece_counts(file)
    read = _WHILE_READING * stored
    if file.suffix == ".vtp":
        return Size(0, points, max(read, points * (12 + 4 * fields)))
    # corners, their offset, the type; coordinates may be double, and so may fields
    return Size(cells, 0, max(read, cells * (8 * 8 + 8 + 1 + 8 * fields) + 24 * points))
