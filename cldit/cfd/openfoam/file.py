"""One file of an OpenFOAM case: its header, and the lists in it, ascii or binary, plain or gz.

Formats after the OpenFOAM user guide ("File format") and v1912's own output; sizes of binary
numbers come from the header's `arch` entry, and every list must end where its bracket does, so a
wrong size cannot go unnoticed.
"""

from __future__ import annotations

import gzip
import re
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.case import only_claimant
from cldit.cfd.openfoam.collated import COLLATED, block_of
from cldit.errors import SprayError
from cldit.spray.result import Floats

_HEADER = re.compile(rb"FoamFile\s*\{(.*?)\}", re.DOTALL)
_GAP = rb"(?:\s|//[^\n]*\n|/\*.*?\*/)*"
_LIST = re.compile(_GAP + rb"(?:List<\w+>)?\s*(\d+)\s*([({])", re.DOTALL)
_UNIFORM = re.compile(rb"\buniform\s+([^;]+);")
_NONUNIFORM = re.compile(rb"\bnonuniform\s*(?=List|\d)")
_BRACKETS = bytes.maketrans(b"()", b"  ")


@dataclass(frozen=True)
class FoamFile:
    """Content of a file behind its header; sizes in bytes, None where the header does not say."""

    path: Path
    binary: bool
    order: str
    label_sizes: tuple[int, ...]
    scalar_sizes: tuple[int, ...]
    body: bytes
    block: int | None = None  # of a collated file
    kind: str = ""  # class in the header, such as scalarField

    @property
    def nothing(self) -> bool:
        """A processor without anything of this kind: only collated files have such blocks."""
        return self.block is not None and not self.body.strip()

    def fail(self, what: str) -> SprayError:
        """An error that names the file."""
        where = "" if self.block is None else f", block {self.block}"
        return SprayError(f"{self.path}{where}: {what}")


def find_foam(path: Path) -> Path | None:
    """The file, or its gz form, whichever there is.

    Raises:
        SprayError: there are both.
    """
    packed = path.with_name(path.name + ".gz")
    found = [each for each in (path, packed) if each.is_file()]
    return only_claimant(str(path), found) if found else None


def read_foam(path: Path, block: int | None = None) -> FoamFile:
    """Reads a file by its plain name; `.gz` beside it is taken where the plain file is missing.

    Args:
        path: plain name.
        block: which processor's, of a collated file.

    Raises:
        SprayError: there is neither, it cannot be unpacked, or it has no OpenFOAM header.
    """
    found = find_foam(path)
    if found is None:
        raise SprayError(f"{path}: is missing (also as .gz)")
    try:
        content = found.read_bytes()
        if found.suffix == ".gz":
            content = gzip.decompress(content)
    except (OSError, EOFError, zlib.error) as error:
        raise SprayError(f"{found}: cannot be read ({error})") from error
    entries, body = _head(content, found)
    if entries.get(b"class", b"").strip() == COLLATED:
        if block is None:
            raise SprayError(f"{found}: is collated, but not in a folder processorsN")
        arch = entries.get(b"arch")
        first, own = block_of(body, found, block)
        entries, body = _head(first, found)
        if block > 0:
            body = own
            if _HEADER.search(own[:10_000]):
                entries, body = _head(own, found)
        if arch is not None:
            entries.setdefault(b"arch", arch)
    elif block is not None:
        raise SprayError(f"{found}: is not collated, though its folder is")
    arch_text = entries.get(b"arch", b"").decode("latin-1")
    label = re.search(r"label=(\d+)", arch_text)
    scalar = re.search(r"scalar=(\d+)", arch_text)
    return FoamFile(
        path=found,
        binary=entries.get(b"format", b"ascii").strip() == b"binary",
        order=">" if "MSB" in arch_text else "<",
        label_sizes=(int(label.group(1)) // 8,) if label else (4, 8),
        scalar_sizes=(int(scalar.group(1)) // 8,) if scalar else (8, 4),
        body=body,
        block=block,
        kind=entries.get(b"class", b"").decode("latin-1").strip(),
    )


def _head(content: bytes, path: Path) -> tuple[dict[bytes, bytes], bytes]:
    """Entries of the header, and what follows it."""
    head = _HEADER.search(content[:10_000])
    if head is None:
        raise SprayError(f"{path}: is not an OpenFOAM file (no FoamFile header)")
    entries = dict(re.findall(rb'(\w+)\s+("[^"]*"|[^;]+);', head.group(1)))
    return entries, content[head.end() :]


def _open(file: FoamFile, at: int) -> tuple[int, bytes, int]:
    """Count, opening bracket, and offset behind it, of the list that begins at `at`."""
    match = _LIST.match(file.body, at)
    if match is None:
        raise file.fail("no list where one is expected; the file is truncated or of another kind")
    return int(match.group(1)), match.group(2), match.end()


def _parse(file: FoamFile, text: bytes) -> Floats:
    if not text.strip(b" \n\r\t()"):
        return np.empty(0)  # of blanks alone numpy makes a number
    with warnings.catch_warnings():
        # text that is no number ends the array early, with a warning; the count tells the caller
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return np.asarray(np.fromstring(text.translate(_BRACKETS), dtype=np.float64, sep=" "))
        except ValueError as error:
            raise file.fail(f"holds text that is no number ({error})") from error


def _raw(
    file: FoamFile, kind: str, sizes: tuple[int, ...], count: int, at: int
) -> tuple[NDArray[np.generic], int]:
    """`count` binary numbers at `at` and the offset behind their closing bracket."""
    for size in sizes:
        end = at + count * size
        if file.body[end : end + 1] == b")":
            values = np.frombuffer(file.body, f"{file.order}{kind}{size}", count, at)
            return values, end + 1
    raise file.fail(
        f"truncated, or not of the number size in its header: no {count} binary numbers of "
        f"{' or '.join(map(str, sizes))} bytes"
    )


def _list(file: FoamFile, kind: str, width: int, at: int) -> tuple[NDArray[np.generic], int]:
    """A list of `width` numbers an entry, (N, width), and the offset behind it."""
    count, bracket, begin = _open(file, at)
    if bracket == b"{":
        end = file.body.find(b"}", begin)
        value = _parse(file, file.body[begin:end]) if end >= 0 else np.empty(0)
        if value.size != width:
            raise file.fail(f"a uniform list of {value.size} numbers, expected {width}")
        return np.tile(value, (count, 1)), end + 1
    if file.binary and count:
        sizes = file.label_sizes if kind == "i" else file.scalar_sizes
        values, end = _raw(file, kind, sizes, count * width, begin)
        return values.reshape(count, width), end
    # entries of one number have no brackets of their own; a list of vectors is the last in a file
    end = file.body.find(b")", begin) if width == 1 else file.body.rfind(b")")
    values = _parse(file, file.body[begin:end] if end >= begin else file.body[begin:])
    if end < begin or values.size != count * width:
        raise file.fail(
            f"truncated or damaged: {values.size} numbers where {count * width} are announced"
        )
    return values.reshape(count, width), end + 1


def whole(file: FoamFile, values: NDArray[np.generic]) -> NDArray[np.int64]:
    """`values` in `file` as integers of the same shape; text such as 1.5 or 1e300 is refused."""
    numbers = np.asarray(values)
    if numbers.dtype.kind == "f" and not np.all(np.abs(numbers) < 2.0**53):
        raise file.fail("holds a label that is no whole number")
    integers = numbers.astype(np.int64)
    if np.any(integers != numbers):
        raise file.fail("holds a label that is no whole number")
    return integers


def scalars(file: FoamFile) -> Floats:
    """A scalarField, (N,)."""
    if file.nothing:
        return np.empty(0)
    return _list(file, "f", 1, 0)[0].reshape(-1).astype(np.float64)


def vectors(file: FoamFile) -> Floats:
    """A vectorField, (N, 3)."""
    if file.nothing:
        return np.empty((0, 3))
    return _list(file, "f", 3, 0)[0].astype(np.float64)


def labels(file: FoamFile) -> NDArray[np.int64]:
    """A labelList, (N,)."""
    return whole(file, _list(file, "i", 1, 0)[0].reshape(-1))


def faces(file: FoamFile) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """A faceList or faceCompactList: the corners of all faces, and where each begins, (F + 1,)."""
    if file.binary:
        start, end = _list(file, "i", 1, 0)
        corners, _ = _list(file, "i", 1, end)
        return whole(file, corners.reshape(-1)), whole(file, start.reshape(-1))
    count, _, begin = _open(file, 0)
    numbers = whole(file, _parse(file, file.body[begin : file.body.rfind(b")")]))
    if count and numbers.size % count == 0 and (width := numbers.size // count) > 1:
        table = numbers.reshape(count, width)
        if np.all(table[:, 0] == width - 1):  # all faces have as many corners: no need to walk
            return table[:, 1:].reshape(-1), np.arange(count + 1) * (width - 1)
    place = np.empty(count + 1, dtype=np.int64)
    here = 0
    sizes = numbers.tolist()
    for face in range(count):
        place[face] = here
        here += 1 + (sizes[here] if here < len(sizes) and sizes[here] > 0 else len(sizes))
    place[count] = here
    if here != len(sizes):
        raise file.fail(f"truncated or damaged: {len(sizes)} numbers do not make {count} faces")
    keep = np.ones(len(sizes), dtype=bool)
    keep[place[:-1]] = False
    return numbers[keep], place - np.arange(count + 1)


def internal_field(file: FoamFile, cells: int) -> Floats:
    """The internalField (N,) of a volScalarField in `file`, of a mesh of `cells`.

    Raises:
        SprayError: there is none, it is no scalar, or its length is not `cells`.
    """
    begin = file.body.find(b"internalField")
    if begin < 0:
        raise file.fail("has no internalField")
    entry = begin + len(b"internalField")
    nonuniform = _NONUNIFORM.search(file.body, entry, entry + 200)
    if nonuniform is None:
        uniform = _UNIFORM.search(file.body, entry, entry + 200)
        value = _parse(file, uniform.group(1)) if uniform else np.empty(0)
        if value.size != 1:
            raise file.fail("internalField is neither `uniform <number>` nor a list of numbers")
        return np.full(cells, value[0])
    values = _list(file, "f", 1, nonuniform.end())[0].reshape(-1).astype(np.float64)
    if len(values) != cells:
        raise file.fail(f"{len(values)} values, but the mesh has {cells} cells")
    return values


def particles(file: FoamFile) -> Floats:
    """Where the parcels of a cloud are, one row a parcel.

    (N, 4): x, y, z, cell; or (N, 7): four barycentric coordinates, cell, face and point of the
    tetrahedron. Which of the two is told by the rows, not by the file's name: `positions` of
    OpenFOAM.org 5 and later holds the second.
    """
    if file.nothing:
        return np.empty((0, 4))
    count, bracket, begin = _open(file, 0)
    if count == 0:
        return np.empty((0, 4))
    if bracket != b"(":
        raise file.fail("a cloud cannot be a uniform list")
    if file.binary:
        return _binary_particles(file, count, begin)
    end = file.body.rfind(b")")
    numbers = _parse(file, file.body[begin:end])
    for width in (4, 7):
        if numbers.size == count * width:
            return numbers.reshape(count, width)
    raise file.fail(
        f"truncated or damaged: {numbers.size} numbers for {count} parcels, expected 4 (position "
        "and cell) or 7 (barycentric coordinates, cell, face, point) for each"
    )


def _binary_particles(file: FoamFile, count: int, begin: int) -> Floats:
    """Records in brackets, each on its own line: scalars, then labels."""
    first = file.body.find(b"(", begin)
    for reals, integers in ((3, 1), (4, 3)):
        for scalar in file.scalar_sizes:
            for label in file.label_sizes:
                size = reals * scalar + integers * label
                after = file.body[first + 1 + size : first + 6 + size]
                gap = after.find(b"(") if count > 1 else 1
                if after[:1] != b")" or gap < 1:
                    continue
                record = np.dtype(
                    {
                        "names": ["open", "reals", "integers", "close"],
                        "formats": [
                            "S1",
                            (f"{file.order}f{scalar}", reals),
                            (f"{file.order}i{label}", integers),
                            "S1",
                        ],
                        "offsets": [0, 1, 1 + reals * scalar, 1 + size],
                        "itemsize": 1 + size + gap,
                    }
                )
                # the last record has no gap behind it
                span = file.body[first : first + count * record.itemsize - gap + 1]
                span += b"\0" * (count * record.itemsize - len(span))
                rows = np.frombuffer(span, record, count)
                if np.all(rows["open"] == b"(") and np.all(rows["close"] == b")"):
                    return np.concatenate([rows["reals"], rows["integers"]], axis=1).astype(
                        np.float64
                    )
    raise file.fail(f"truncated or damaged: no {count} binary parcels")
