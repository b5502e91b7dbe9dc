"""XML of a VTK file, read before vtk reads it: its size, and the positions of its arrays.

vtk trusts an `offset`: with a wrong one it reads another array, or ends the process for lack of
memory. Layout after the VTK file formats, "Appended data section".
"""

import base64
import binascii
import mmap
import re
from dataclasses import dataclass, replace
from math import inf, prod
from pathlib import Path
from typing import BinaryIO, Literal

from cldit.cfd.size import Size
from cldit.errors import SprayError
from cldit.io.files import open_regular

_TAG = re.compile(
    rb"<(?:VTKFile|Piece|DataArray|Array|Points|Cells|Verts|Lines|Strips|Polys|\w+Grid|\w+Data)"
    rb"\b[^>]*>"
)
_NAME = re.compile(rb"<(\w+)")
_KINDS = {".vtu": "UnstructuredGrid", ".vtp": "PolyData", ".vti": "ImageData"}
_KINDS |= {".vtr": "RectilinearGrid", ".vts": "StructuredGrid"}
_COUNT = re.compile(rb'\b(NumberOf\w+|offset)\s*=\s*["\']([^"\']*)["\']')
_EXTENT = re.compile(rb'\b(?:Whole)?Extent\s*=\s*["\']([-\d\s]+)["\']')  # of a grid by rows
_SPACING = re.compile(rb'\bSpacing\s*=\s*["\']([^"\']*)["\']')
# section of a piece: array in it (empty: any), count of the piece, numbers for each
_COUNTED: dict[bytes, tuple[bytes, bytes, int]] = {
    b"Points": (b"", b"NumberOfPoints", 3),
    b"Cells": (b"types", b"NumberOfCells", 1),
} | {
    name: (b"offsets", b"NumberOf" + name, 1) for name in (b"Verts", b"Lines", b"Strips", b"Polys")
}
_MOST_PACKED = 10_000  # bytes of content for each in the file: LZMA packs zeros by some 7,000
_MOST_COMPONENTS = 100  # of an array: a tensor has 9
_OFFSET = re.compile(rb"\boffset\s*=\s*[\"']([^\"']*)[\"']")
_BEGIN = re.compile(rb"<AppendedData\b[^>]*>\s*_")
_TYPE = re.compile(rb"(?:U?Int|Float)(8|16|32|64)")
_AT_ONCE = 1 << 20  # bytes of a file that are searched at a time
_WHILE_READING = 1.4  # bytes that vtk takes at its peak for one of the file's


def piece_counts(file: Path) -> tuple[int, int]:
    """Points and cells of all pieces of a VTK file in XML."""
    points = cells = 0
    with open_regular(file) as stream:
        tags, _, _ = _xml(stream)
    for piece in (tag for tag in tags.values() if tag.startswith(b"<Piece")):
        counts = {name: int(count) for name, count in _COUNT.findall(piece)}
        points += counts.get(b"NumberOfPoints", 0)
        cells += counts.get(b"NumberOfCells", 0)
        edges = [high - low for low, high in _extent(piece)]
        points += prod(edge + 1 for edge in edges) if edges else 0
        cells += prod(edges) if edges else 0
    return points, cells


def _extent(tag: bytes) -> list[tuple[int, int]]:
    """First and last index of a grid by rows along each axis."""
    match = _EXTENT.search(tag)
    ends = [] if match is None else [int(word) for word in match.group(1).split()]
    return list(zip(ends[::2], ends[1::2], strict=False))


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


def check_head(file: Path) -> None:
    """Refuses a file of another kind than its name says, counts that it cannot contain, at which
    vtk prints messages or ends the process, or that are not those of its arrays, whose rest vtk
    omits, and appended arrays that overlap or are cut off.
    """
    with open_regular(file) as stream:
        tags, opening, begin = _xml(stream)
        end = stream.seek(0, 2)
        _check_counts(file, list(tags.values()), end)
        root = next((tag for tag in tags.values() if tag.startswith(b"<VTKFile")), b"")
        form = _Form(
            size=8 if b'"UInt64"' in root else 4,
            order="big" if b'"BigEndian"' in root else "little",
            packed=b" compressor=" in root,
            encoded=b"base64" in opening or not opening,
        )
        behind = 0
        offsets = (_OFFSET.search(tag) for tag in tags.values())
        for place in sorted({int(match.group(1)) for match in offsets if match}):  # some are shared
            if place < behind:
                raise _damaged(file, f"an array at {place}, inside the previous one")
            behind = place + _Head(file, stream, form, begin + place, end).stored
            if begin + behind > end:
                raise _damaged(file, f"an array at {place} that ends after the file")
        _check_lengths(file, stream, tags, form, begin, end)


def _check_lengths(
    file: Path, stream: BinaryIO, tags: dict[int, bytes], form: _Form, begin: int, end: int
) -> None:
    """Refuses counts of points and cells that differ from the lengths of their arrays."""
    counts: dict[bytes, int] = {}
    section = b""
    for at, tag in tags.items():
        name = _NAME.findall(tag)[0]
        if name == b"Piece":
            counts = {key: int(digits) for key, digits in _COUNT.findall(tag)}
        elif name != b"DataArray":
            section = name
        if name != b"DataArray" or section not in _COUNTED:
            continue
        array, key, width = _COUNTED[section]
        if key not in counts or array not in (b"", _value(tag, b"Name")):
            continue
        if _value(tag, b"format") == b"ascii":
            held = _words(stream, at)
        else:
            appended = _OFFSET.search(tag)
            place = _text_begin(stream, at) if appended is None else begin + int(appended.group(1))
            coded = replace(form, encoded=form.encoded or appended is None)
            if (number := _TYPE.fullmatch(_value(tag, b"type"))) is None:
                continue  # vtk refuses it
            held = _Head(file, stream, coded, place, end).content // (int(number.group(1)) // 8)
        if held != width * counts[key]:
            raise _damaged(file, f"{key.decode()} is {counts[key]}; allowed: {held // width}")


def _value(tag: bytes, name: bytes) -> bytes:
    match = re.search(rb"\b" + name + rb"\s*=\s*[\"']([^\"']*)[\"']", tag)
    return b"" if match is None else match.group(1)


def _text_begin(stream: BinaryIO, at: int) -> int:
    """Place of the first character that is no blank."""
    stream.seek(at)
    head = stream.read(1000)
    return at + len(head) - len(head.lstrip())


def _words(stream: BinaryIO, at: int) -> int:
    """Number of words up to the next tag."""
    stream.seek(at)
    count, rest = 0, b""
    while part := stream.read(_AT_ONCE):
        chunk, stop, _ = (rest + part).partition(b"<")
        if stop:
            return count + len(chunk.split())
        *words, rest = chunk.split(b" ") if not chunk[-1:].isspace() else [chunk, b""]
        count += len(b" ".join(words).split())
    return count + len(rest.split())


def _check_counts(file: Path, tags: list[bytes], size: int) -> None:
    root = next((tag for tag in tags if tag.startswith(b"<VTKFile")), b"")
    kind = re.search(rb"\btype\s*=\s*[\"'](\w+)", root)
    if kind is None or kind.group(1).decode() != _KINDS[file.suffix]:
        problem = "no VTK file in XML" if kind is None else f"of type {kind.group(1).decode()}"
        raise SprayError(f"{file}: is {problem}; expected by its name: {_KINDS[file.suffix]}")
    if file.suffix == ".vti":
        _check_spacing(file, next(tag for tag in tags if tag.startswith(b"<ImageData")))
    for tag in tags:
        counts = {name.decode(): digits for name, digits in _COUNT.findall(tag)}
        for name, digits in counts.items():
            limit = _MOST_COMPONENTS if name.endswith("Components") else _MOST_PACKED * size
            if not digits.strip().isdigit() or int(digits[:20]) > limit:
                raise _damaged(file, f"{name} is {digits.decode('latin-1')!a}")
        if int(counts.get("NumberOfCells", 0)) and not int(counts.get("NumberOfPoints", 1)):
            raise _damaged(file, "cells without points")
    pieces = [ends for tag in tags if tag.startswith(b"<Piece") and (ends := _extent(tag))]
    extent = next((_extent(tag) for tag in tags if b"WholeExtent" in tag), [])
    bounds = [(min(axis)[0], max(b for _, b in axis)) for axis in zip(*pieces, strict=False)]
    if pieces and (len(extent) != 3 or any(a > b for piece in pieces for a, b in piece)):
        raise _damaged(file, "extents that are none")
    if pieces and extent != bounds:
        raise _damaged(file, f"pieces that fill {bounds} of {extent}")


def _check_spacing(file: Path, image: bytes) -> None:
    """Refuses an image without edges of its cells, for which vtk takes 1 m, or cells of no size."""
    match = _SPACING.search(image)
    spacing = "" if match is None else match.group(1).decode("latin-1")
    try:
        good = [0.0 < float(word) < inf for word in spacing.split()] == [True] * 3
    except ValueError:
        good = False
    if not good:
        raise _damaged(file, f"Spacing is {spacing!a}; allowed: three numbers above 0")


_LEGACY = re.compile(
    rb"\n(DIMENSIONS|POINTS|VERTICES|LINES|POLYGONS|TRIANGLE_STRIPS|CELLS|CELL_TYPES|CELL_DATA"
    rb"|POINT_DATA|[XYZ]_COORDINATES)[ \t]+([^\n]*)"
)


def check_legacy(file: Path) -> None:
    """Refuses counts in a legacy file that it cannot contain."""
    if not (size := file.stat().st_size):
        raise _damaged(file, "empty")
    with (
        open_regular(file) as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as mapped,
    ):
        for match in _LEGACY.finditer(mapped):
            name, words = match.group(1).decode(), match.group(2).split()
            numbers = [word for word in words if not word[:1].isalpha()]
            good = bool(numbers) and all(word.isdigit() and len(word) < 19 for word in numbers)
            counts = [int(word) for word in numbers] if good else []
            if name == "DIMENSIONS":
                good = len(counts) == 3 and 0 < prod(max(count - 1, 1) for count in counts) <= size
            if not good or max(counts) > size:
                raise _damaged(file, f"{name} {match.group(2)[:60].decode('latin-1')!a}")


def _xml(stream: BinaryIO) -> tuple[dict[int, bytes], bytes, int]:
    """Tags up to the appended arrays, or to the end, by their ends; the text at which these begin,
    and its end."""
    tags: dict[int, bytes] = {}
    rest, offset = b"", 0
    while part := stream.read(_AT_ONCE):
        chunk = rest + part
        stop = _BEGIN.search(chunk)
        end = 0
        for tag in _TAG.finditer(chunk, 0, len(chunk) if stop is None else stop.start()):
            tags[offset + tag.end()] = tag.group()
            end = tag.end()
        if stop is not None:
            return tags, stop.group(), offset + stop.end()
        kept = max(end, len(chunk) - 1000)
        offset, rest = offset + kept, chunk[kept:]
    return tags, b"", 0


def _damaged(file: Path, reason: str) -> SprayError:
    return SprayError(f"{file}: is damaged or truncated ({reason})")


@dataclass(frozen=True)
class _Head:
    """Numbers in front of the array that begins at `begin` of a file with `end` bytes."""

    file: Path
    stream: BinaryIO
    form: _Form
    begin: int
    end: int

    def _numbers(self, count: int) -> list[int]:
        form, begin = self.form, self.begin
        self.stream.seek(begin)
        raw = self.stream.read(min(form.stored(count * form.size), max(self.end - begin, 0)))
        try:
            content = base64.b64decode(raw, validate=True) if form.encoded else raw
        except binascii.Error as error:
            raise _damaged(self.file, f"no array where {begin} bytes are before it") from error
        if len(content) < count * form.size:
            raise _damaged(self.file, f"an array that begins at {begin} of {self.end} bytes")
        parts = (content[n * form.size : (n + 1) * form.size] for n in range(count))
        return [int.from_bytes(part, form.order) for part in parts]

    @property
    def stored(self) -> int:
        """Bytes in the file that the array takes, at least."""
        form, count = self.form, self._numbers(1)[0]
        if not form.packed:  # one number and its bytes, encoded together
            return form.stored(form.size + count)
        if not count:
            return form.size
        if count * form.size > self.end - self.begin:
            held = self.end - self.begin
            raise _damaged(self.file, f"an array of {count} blocks in {held} bytes")
        sizes = self._numbers(3 + count)[3:]
        return form.stored((3 + count) * form.size) + form.stored(sum(sizes))

    @property
    def content(self) -> int:
        """Bytes of its numbers once they are unpacked."""
        count = self._numbers(1)[0]
        if not self.form.packed or not count:
            return count
        blocks, size, tail = self._numbers(3)
        return (blocks - 1) * size + (tail or size)
