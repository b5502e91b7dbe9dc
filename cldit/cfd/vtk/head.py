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
from xml.parsers import expat

from cldit.cfd.inputs import AT_ONCE, HEAD_BYTES, WHILE_READING, Size
from cldit.errors import SprayError
from cldit.io.files import open_regular

_KINDS = {".vtu": "UnstructuredGrid", ".vtp": "PolyData", ".vti": "ImageData"}
_KINDS |= {".vtr": "RectilinearGrid", ".vts": "StructuredGrid"}
# section of a piece: array in it (empty: any), count of the piece, numbers for each
_COUNTED = {"Points": ("", "NumberOfPoints", 3), "Cells": ("types", "NumberOfCells", 1)} | {
    name: ("offsets", f"NumberOf{name}", 1) for name in ("Verts", "Lines", "Strips", "Polys")
}
_MOST_PACKED = 10_000  # bytes of content for each in the file: LZMA packs zeros by some 7,000
_MOST_COMPONENTS = 100  # of an array: a tensor has 9
_TAG = re.compile(rb"<[^>]*>\s*")
_TYPE = re.compile(r"(?:U?Int|Float)(8|16|32|64)")
_BAD_NAME = re.compile(rb"Name=[\"']([^\"'\n]*<[^\"'\n]*)[\"']")

Tag = tuple[str, dict[str, str], int]
"""Name of an element, its attributes, and the place of its tag."""


def _xml(file: Path, stream: BinaryIO) -> tuple[list[Tag], Tag | None]:
    """Elements of a file, and the one with the appended arrays, at which XML ends."""
    tags: list[Tag] = []
    parser = expat.ParserCreate()

    def started(name: str, attributes: dict[str, str]) -> None:
        tags.append((name, attributes, parser.CurrentByteIndex))
        if name == "AppendedData":
            raise StopIteration

    parser.StartElementHandler = started
    try:
        while part := stream.read(AT_ONCE):
            parser.Parse(part)
        parser.Parse(b"", True)
    except StopIteration:
        return tags[:-1], tags[-1]
    except (expat.ExpatError, LookupError, ValueError) as error:  # an encoding that is none
        stream.seek(0)
        if (bad := _BAD_NAME.search(stream.read(AT_ONCE))) is not None:
            raise SprayError(
                f"{file}: names a field {bad.group(1).decode('latin-1')!r} with a mark that XML "
                "does not allow, as foamToVTK of v1912 does; export only what is needed: "
                "foamToVTK -fields '(T p rho C7H16)'"
            ) from error
        raise _damaged(file, f"XML: {error}") from error
    return tags, None


def piece_counts(file: Path) -> tuple[int, int]:
    """Points and cells of all pieces of a VTK file in XML."""
    points = cells = 0
    with open_regular(file) as stream:
        tags, _ = _xml(file, stream)
    for piece in (attributes for name, attributes, _ in tags if name == "Piece"):
        points += int(piece.get("NumberOfPoints", 0))
        cells += int(piece.get("NumberOfCells", 0))
        edges = [high - low for low, high in _extent(piece.get("Extent", ""))]
        points += prod(edge + 1 for edge in edges) if edges else 0
        cells += prod(edges) if edges else 0
    return points, cells


def _extent(text: str) -> list[tuple[int, int]]:
    """First and last index of a grid by rows along each axis; none if they are no numbers."""
    if not re.fullmatch(r"\s*(?:-?\d+\s+)*-?\d+\s*", text):
        return []
    ends = [int(word) for word in text.split()]
    return list(zip(ends[::2], ends[1::2], strict=False))


def vtk_size(file: Path, *, fields: int) -> Size:
    """Estimate for the mesh or cloud in `file` with `fields` fields; cells count as hexahedra."""
    stored = file.stat().st_size
    if file.suffix == ".vtk":  # binary: nine integers a cell that become nine of twice the size
        return Size(stored // 70, 0, 2.0 * stored)
    points, cells = piece_counts(file)
    read = WHILE_READING["xml"] * stored
    if file.suffix == ".vtp":
        return Size(0, points, max(read, points * (12 + 4 * fields)))
    # corners, their offset, the type; coordinates may be double, and so may fields
    return Size(cells, 0, max(read, cells * (8 * 8 + 8 + 1 + 8 * fields) + 24 * points))


@dataclass(frozen=True)
class _Arrays:
    """Arrays in a file of `end` bytes, whose heads, numbers of `size` bytes, state their lengths.

    packed: in blocks; encoded: in base64.
    """

    file: Path
    stream: BinaryIO
    end: int
    size: int
    order: Literal["big", "little"]
    packed: bool
    encoded: bool

    def _written(self, count: int) -> int:
        """Bytes in the file for `count` bytes of content."""
        return -(-count // 3) * 4 if self.encoded else count

    def _numbers(self, begin: int, count: int) -> list[int]:
        """Numbers in front of the array that begins at `begin`."""
        self.stream.seek(begin)
        raw = self.stream.read(min(self._written(count * self.size), max(self.end - begin, 0)))
        try:
            content = base64.b64decode(raw, validate=True) if self.encoded else raw
        except binascii.Error as error:
            raise _damaged(self.file, f"no array where {begin} bytes are before it") from error
        if len(content) < count * self.size:
            raise _damaged(self.file, f"an array that begins at {begin} of {self.end} bytes")
        parts = (content[n * self.size : (n + 1) * self.size] for n in range(count))
        return [int.from_bytes(part, self.order) for part in parts]

    def stored(self, begin: int) -> int:
        """Bytes in the file that an array takes, at least."""
        count = self._numbers(begin, 1)[0]
        if not self.packed:  # one number and its bytes, encoded together
            return self._written(self.size + count)
        if not count:
            return self.size
        if count * self.size > self.end - begin:
            raise _damaged(self.file, f"an array of {count} blocks in {self.end - begin} bytes")
        sizes = self._numbers(begin, 3 + count)[3:]
        return self._written((3 + count) * self.size) + self._written(sum(sizes))

    def content(self, begin: int) -> int:
        """Bytes of the numbers of an array once they are unpacked."""
        count = self._numbers(begin, 1)[0]
        if not self.packed or not count:
            return count
        blocks, size, tail = self._numbers(begin, 3)
        return (blocks - 1) * size + (tail or size)


def check_head(file: Path) -> None:
    """Refuses a file of another kind than its name says, counts that it cannot contain, at which
    vtk prints messages or ends the process, or that are not those of its arrays, whose rest vtk
    omits, and appended arrays that overlap or are cut off.
    """
    with open_regular(file) as stream:
        tags, appended = _xml(file, stream)
        end = stream.seek(0, 2)
        _check_counts(file, tags, end)
        root, begin = tags[0][1], 0
        if appended is not None:
            begin = _content_at(stream, appended[2])
            stream.seek(begin)
            if stream.read(1) != b"_":
                raise _damaged(file, "appended arrays without their mark")
            begin += 1
        arrays = _Arrays(
            file,
            stream,
            end,
            size=8 if root.get("header_type") == "UInt64" else 4,
            order="big" if root.get("byte_order") == "BigEndian" else "little",
            packed="compressor" in root,
            encoded=appended is None or appended[1].get("encoding") == "base64",
        )
        behind = 0
        for place in sorted(
            {int(a["offset"]) for _, a, _ in tags if "offset" in a}
        ):  # some are shared
            if place < behind:
                raise _damaged(file, f"an array at {place}, inside the previous one")
            behind = place + arrays.stored(begin + place)
            if begin + behind > end:
                raise _damaged(file, f"an array at {place} that ends after the file")
        _check_lengths(arrays, tags, begin)


def _content_at(stream: BinaryIO, place: int) -> int:
    """Place of the first character that is no blank behind the tag at `place`."""
    stream.seek(place)
    match = _TAG.match(stream.read(HEAD_BYTES))
    return place if match is None else place + match.end()


def _check_lengths(arrays: _Arrays, tags: list[Tag], begin: int) -> None:
    """Refuses counts of points and cells that differ from the lengths of their arrays."""
    piece: dict[str, str] = {}
    section = ""
    for name, attributes, place in tags:
        if name == "Piece":
            piece = attributes
        elif name != "DataArray":
            section = name
        if name != "DataArray" or section not in _COUNTED:
            continue
        array, key, width = _COUNTED[section]
        if key not in piece or array not in ("", attributes.get("Name")):
            continue
        if attributes.get("format") == "ascii":
            held = _words(arrays.stream, _content_at(arrays.stream, place))
        elif (number := _TYPE.fullmatch(attributes.get("type", ""))) is None:
            continue  # vtk refuses it
        elif "offset" in attributes:
            held = arrays.content(begin + int(attributes["offset"])) // (int(number[1]) // 8)
        else:
            at = _content_at(arrays.stream, place)
            held = replace(arrays, encoded=True).content(at) // (int(number[1]) // 8)
        if held != width * int(piece[key]):
            raise _damaged(arrays.file, f"{key} is {piece[key]}; allowed: {held // width}")


def _words(stream: BinaryIO, at: int) -> int:
    """Number of words up to the next tag."""
    stream.seek(at)
    count, inside = 0, False
    while part := stream.read(AT_ONCE):
        text, tag, _ = part.partition(b"<")
        continued = inside and text and not text[:1].isspace()
        count += len(text.split()) - bool(continued)
        if tag:
            break
        inside = not text[-1:].isspace()
    return count


def _check_counts(file: Path, tags: list[Tag], size: int) -> None:
    kind = tags[0][1].get("type") if tags and tags[0][0] == "VTKFile" else None
    if kind != _KINDS[file.suffix]:
        problem = "no VTK file in XML" if kind is None else f"of type {kind}"
        raise SprayError(f"{file}: is {problem}; expected by its name: {_KINDS[file.suffix]}")
    for _, attributes, _ in tags:
        counts = {k: v for k, v in attributes.items() if k.startswith("NumberOf") or k == "offset"}
        for name, digits in counts.items():
            limit = _MOST_COMPONENTS if name.endswith("Components") else _MOST_PACKED * size
            if not digits.strip().isdecimal() or int(digits.strip()[:20]) > limit:
                raise _damaged(file, f"{name} is {digits!a}")
        if int(counts.get("NumberOfCells", 0)) and not int(counts.get("NumberOfPoints", 1)):
            raise _damaged(file, "cells without points")
    grid = next((attributes for name, attributes, _ in tags if name == kind), {})
    if file.suffix == ".vti":
        _check_spacing(file, grid.get("Spacing", ""))
    extents = [
        _extent(attributes.get("Extent", "")) for name, attributes, _ in tags if name == "Piece"
    ]
    pieces, extent = list(filter(None, extents)), _extent(grid.get("WholeExtent", ""))
    bounds = [(min(axis)[0], max(b for _, b in axis)) for axis in zip(*pieces, strict=False)]
    if pieces and (len(extent) != 3 or any(a > b for piece in pieces for a, b in piece)):
        raise _damaged(file, "extents that are none")
    if pieces and extent != bounds:
        raise _damaged(file, f"pieces that fill {bounds} of {extent}")


def _check_spacing(file: Path, spacing: str) -> None:
    """Refuses an image without edges of its cells, for which vtk takes 1 m, or cells of no size."""
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


def _damaged(file: Path, reason: str) -> SprayError:
    return SprayError(f"{file}: is damaged or truncated ({reason})")
