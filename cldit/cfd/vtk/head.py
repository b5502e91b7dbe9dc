"""XML of a VTK file, read before vtk reads it: its size, and the positions of its arrays.

vtk trusts an `offset`: with a wrong one it reads another array, or ends the process for lack of
memory. Layout after the VTK file formats, "Appended data section".
"""

from __future__ import annotations

import base64
import binascii
import re
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import BinaryIO, Literal

from cldit.cfd.size import Size
from cldit.errors import SprayError

_TAG = re.compile(rb"<(?:VTKFile|Piece|DataArray|Array)\b[^>]*>")
_COUNT = re.compile(rb'\bNumberOf(Points|Cells)\s*=\s*["\'](\d+)["\']')
_EXTENT = re.compile(rb'\bExtent\s*=\s*["\']([-\d\s]+)["\']')  # of a grid by rows
_OFFSET = re.compile(rb"\boffset\s*=\s*[\"']([^\"']*)[\"']")
_BEGIN = re.compile(rb"<AppendedData\b[^>]*>\s*_")
_AT_ONCE = 1 << 20
_WHILE_READING = 1.4  # bytes that vtk takes at its peak for one of the file's


def piece_counts(file: Path) -> tuple[int, int]:
    """Points and cells of all pieces of a VTK file in XML."""
    points = cells = 0
    with file.open("rb") as stream:
        tags, _, _ = _xml(stream)
    for piece in (tag for tag in tags if tag.startswith(b"<Piece")):
        found = {name: int(count) for name, count in _COUNT.findall(piece)}
        points += found.get(b"Points", 0)
        cells += found.get(b"Cells", 0)
        if (extent := _EXTENT.search(piece)) is not None:
            ends = [int(text) for text in extent.group(1).split()]
            edges = [high - low for low, high in zip(ends[::2], ends[1::2], strict=False)]
            points += prod(edge + 1 for edge in edges)
            cells += prod(edges)
    return points, cells


def vtk_size(file: Path, *, fields: int) -> Size:
    """Estimate for the mesh or cloud in `file` with `fields` fields; cells count as hexahedra."""
    stored = file.stat().st_size
    if file.suffix == ".vtk":  # binary: nine integers a cell that become nine of twice the size
        return Size(stored // 70, 0, 2.0 * stored)
    points, cells = piece_counts(file)
    read = _WHILE_READING * stored
    if file.suffix == ".vtp":
        return Size(0, points, max(read, points * (12 + 4 * fields)))
    # corners, their offset, the type; coordinates may be double, and so may fields
    return Size(cells, 0, max(read, cells * (8 * 8 + 8 + 1 + 8 * fields) + 24 * points))


@dataclass(frozen=True)
class _Form:
    """Storage of arrays: bytes of a number in their heads, packed or not, base64 or not."""

    size: int
    order: Literal["big", "little"]
    packed: bool
    encoded: bool

    def stored(self, count: int) -> int:
        """Bytes in the file for `count` bytes of content."""
        return -(-count // 3) * 4 if self.encoded else count


def check_appended(file: Path) -> None:
    """Refuses a file in which two arrays overlap, or one ends after the file."""
    with file.open("rb") as stream:
        tags, found, begin = _xml(stream)
        if not found:
            return  # the arrays lie between the tags
        end = stream.seek(0, 2)
        whole = next((tag for tag in tags if tag.startswith(b"<VTKFile")), b"")
        form = _Form(
            size=8 if b'"UInt64"' in whole else 4,
            order="big" if b'"BigEndian"' in whole else "little",
            packed=b" compressor=" in whole,
            encoded=b"base64" in found,
        )
        behind = 0
        for place in sorted(_places(file, tags)):
            if place < behind:
                raise _damaged(file, f"an array at {place}, inside the previous one")
            behind = place + _length(stream, form, begin + place, end, file)
            if begin + behind > end:
                raise _damaged(file, f"an array at {place} that ends after the file")


def _xml(stream: BinaryIO) -> tuple[list[bytes], bytes, int]:
    """Tags up to the appended arrays, or to the end; the text at which these begin, its end."""
    tags: list[bytes] = []
    rest, before = b"", 0
    while part := stream.read(_AT_ONCE):
        text = rest + part
        stop = _BEGIN.search(text)
        last = 0
        for tag in _TAG.finditer(text, 0, len(text) if stop is None else stop.start()):
            tags.append(tag.group())
            last = tag.end()
        if stop is not None:
            return tags, stop.group(), before + stop.end()
        kept = max(last, len(text) - 1000)
        before, rest = before + kept, text[kept:]
    return tags, b"", 0


def _damaged(file: Path, what: str) -> SprayError:
    return SprayError(f"{file}: is damaged or truncated ({what})")


def _places(file: Path, tags: list[bytes]) -> set[int]:
    """Offsets in the XML, each once: time steps may share one."""
    found = {each.group(1) for tag in tags if (each := _OFFSET.search(tag)) is not None}
    for text in found:
        if not text.strip().isdigit():
            raise _damaged(file, f"an offset {text.decode('latin-1')!a}")
    return {int(text) for text in found}


def _length(stream: BinaryIO, form: _Form, begin: int, end: int, file: Path) -> int:
    """Bytes in the file that the array at `begin` takes, at least."""

    def numbers(count: int) -> list[int]:
        stream.seek(begin)
        raw = stream.read(min(form.stored(count * form.size), max(end - begin, 0)))
        try:
            content = base64.b64decode(raw, validate=True) if form.encoded else raw
        except binascii.Error as error:
            raise _damaged(file, f"no array where {begin} bytes are before it") from error
        if len(content) < count * form.size:
            raise _damaged(file, f"an array that begins at {begin} of {end} bytes")
        parts = (content[n * form.size : (n + 1) * form.size] for n in range(count))
        return [int.from_bytes(part, form.order) for part in parts]

    count = numbers(1)[0]
    if not form.packed:  # one number and its bytes, encoded together
        return form.stored(form.size + count)
    if not count:
        return form.size
    if count * form.size > end - begin:
        raise _damaged(file, f"an array of {count} blocks in {end - begin} bytes")
    sizes = numbers(3 + count)[3:]
    return form.stored((3 + count) * form.size) + form.stored(sum(sizes))
