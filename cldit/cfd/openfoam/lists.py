"""Lists and entries in a file of an OpenFOAM case: numbers, vectors, labels, faces and parcels.

Sizes of binary numbers come from the header's `arch` entry, and every list must end at its bracket,
so that a wrong size is noticed. Entries above a list follow the OpenFOAM user guide ("Basic
input/output file format"). foamlib 1.7 reads these, too, but expands neither macros nor `#include`.
Other directives (#calc, #eval) are refused: OpenFOAM writes results without any.
"""

import re
import warnings
from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.cfd.inputs import AT_ONCE, content
from cldit.cfd.mapping.file import SI_UNITS
from cldit.cfd.mesh.cells import AnyFloats, Labels, narrowed, walk_faces
from cldit.cfd.openfoam.file import GAP, FoamFile, find_foam, open_foam, without_comments
from cldit.cfd.tolerances import EXACT

_KEY = re.compile(GAP + rb'("[^"\n]*"|[^\s"{}();]++)', re.DOTALL)
_PART = re.compile(rb'"[^"]*"|//[^\n]*|/\*.*?\*/|[{}();]|List<(\w+)>\s*(\d{1,15})\s*\(', re.DOTALL)
_NUMBERS = {b"scalar": 1, b"vector": 3, b"symmTensor": 6, b"tensor": 9}
_MACRO = re.compile(rb"\$\{?[:.]*(\w+)\}?")


def top_level(
    file: FoamFile, at: int, entries: dict[bytes, bytes], within: tuple[Path, ...] = ()
) -> int:
    """Adds the entries from `at` on to `entries`, up to internalField, and those of included files.

    within: files that include this one. Returns the place of the value of internalField; -1 without
    it.
    """
    while (key := _KEY.match(file.body, at)) is not None:
        name, at = key.group(1), key.end()
        if name.startswith(b"#"):
            line = file.body.find(b"\n", at)
            line = len(file.body) if line < 0 else line
            if name in (b"#include", b"#sinclude", b"#includeIfPresent"):
                _include(file, file.body[at:line], entries, within)
            at = line
            continue
        end = entry_end(file, at)
        entries[name] = file.body[at : min(end, at + 1000)].strip()
        if name == b"internalField":
            return at
        at = end + 1
    return -1


def entry_end(file: FoamFile, at: int) -> int:
    """Place of the semicolon or brace that ends an entry; skips the content of binary lists."""
    depth = 0
    while (part := _PART.search(file.body, at)) is not None:
        mark, at = part.group(), part.end()
        if mark.endswith(b"(") and part.group(1) and file.binary:
            at += int(part.group(2)) * _NUMBERS.get(part.group(1), 1) * file.scalar_sizes[0]
        elif mark.endswith((b"(", b"{")):
            depth += 1
        elif mark in (b")", b"}"):
            depth -= 1
        if (mark == b";" or mark == b"}") and depth <= 0:
            return part.start()
    return len(file.body)


def _include(
    file: FoamFile, line: bytes, entries: dict[bytes, bytes], within: tuple[Path, ...]
) -> None:
    """Adds the entries of an included file; a missing one is named once a macro is not found."""
    name = line.strip().strip(b'"')
    path = find_foam(file.path.parent / name.decode("latin-1"))
    if path is None or path in within:
        entries[b"#include"] = name
        return
    with open_foam(path) as stream:
        body = without_comments(content(stream, path))
    included = FoamFile(path, False, file.order, file.label_sizes, file.scalar_sizes, body)
    top_level(included, 0, entries, (*within, path))


def expanded(
    file: FoamFile, code: bytes, entries: dict[bytes, bytes], within: tuple[bytes, ...] = ()
) -> bytes:
    """Replaces macros such as `$T0` by the entries that they name; `within`: macros around it."""
    code = code.partition(b";")[0]
    while (macro := _MACRO.search(code)) is not None:
        name = macro.group().decode("latin-1")
        if macro.group(1) in within:
            raise file.fail(f"the macro {name} names itself")
        if macro.group(1) not in entries:
            lost = entries.get(b"#include", b"").decode("latin-1")
            where = f'; "{lost}", which it includes, is missing beside it' if lost else ""
            raise file.fail(f"the macro {name} has no entry above it or in its includes{where}")
        value = expanded(file, entries[macro.group(1)], entries, (*within, macro.group(1)))
        code = code[: macro.start()] + value + code[macro.end() :]
    return code


def unit_of(file: FoamFile, entries: dict[bytes, bytes]) -> str | None:
    """Unit by the `dimensions`, as mapping files spell it, or these themselves; None without."""
    inside = re.search(rb"\[([^\]]*)\]", expanded(file, entries.get(b"dimensions", b""), entries))
    if inside is None:
        return None
    dimensions = inside.group(1).decode("latin-1").strip()
    try:
        powers = [float(word) for word in dimensions.split()]
    except ValueError:  # symbols, such as [kg m^-3]
        return dimensions
    return SI_UNITS.get(tuple(powers[:5]) if not any(powers[5:]) else (), f"[{dimensions}]")


_LIST = re.compile(GAP + rb"(?:List<\w++>\s*+)?+(?:(\d++)(?:\s*+([({]))?+|(\())", re.DOTALL)
_NONUNIFORM = re.compile(GAP + rb"nonuniform" + GAP + rb"(?=List|\d|\()", re.DOTALL)
_BRACKETS = bytes.maketrans(b"()", b"  ")


def _open(file: FoamFile, at: int) -> tuple[int, bytes, int]:
    """Count, opening bracket, and the offset after it, of the list that begins at `at`.

    The count is -1 for a list in ascii that does not state it.
    """
    match = _LIST.match(file.body, at)
    if match is not None and match.group(3) and not file.binary:
        return -1, b"(", match.end()
    if match is not None and match.group(3):
        raise file.fail("a binary list without its length")
    # binary files have an empty list as its count alone
    if match is None or not (match.group(2) or int((match.group(1) or b"1")[:20]) == 0):
        raise file.fail("no list where one is expected; the file is truncated or of another kind")
    if len(match.group(1)) >= len(str(2**63)):
        raise file.fail(f"a list of {match.group(1)[:20].decode()}... entries")
    return int(match.group(1)), match.group(2) or b"", match.end()


def _parse(file: FoamFile, begin: int, end: int) -> Iterator[Floats]:
    """Numbers of the text from `begin` to `end`, some megabytes of it at a time.

    Text that is no number ends them early; callers check the count.
    """
    ended = False
    while begin < end and not ended:
        stop = min(begin + AT_ONCE, end)
        while stop < end and not file.body[stop : stop + 1].isspace():
            stop += 1
        chunk = file.body[begin:stop].translate(_BRACKETS)
        begin = stop
        if not chunk.strip():  # of blanks alone numpy makes a number
            continue
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DeprecationWarning)
            try:
                yield np.fromstring(chunk, dtype=np.float64, sep=" ")
            except ValueError as error:
                raise file.fail(f"contains text that is no number ({error})") from error
        ended = bool(caught)


def _parsed(file: FoamFile, begin: int, end: int) -> Floats:
    """All numbers of the text from `begin` to `end`."""
    return np.concatenate([np.empty(0), *_parse(file, begin, end)])


def _raw(
    file: FoamFile, kind: str, sizes: tuple[int, ...], count: int, at: int
) -> tuple[NDArray[np.generic], int]:
    """`count` binary numbers at `at`, and the offset after their closing bracket."""
    for size in sizes:
        end = at + count * size
        if file.body[end : end + 1] == b")":
            values = np.frombuffer(file.body, f"{file.order}{kind}{size}", count, at)
            return values, end + 1
    allowed = " or ".join(map(str, sizes))
    raise file.fail(f"truncated, or its header is wrong: no {count} numbers of {allowed} bytes")


def _list(
    file: FoamFile,
    kind: str,
    width: int,
    at: int,
    expected: int | None = None,
    wording: str = "{} values for {} parcels",
) -> tuple[NDArray[np.generic], int]:
    """List of `width` numbers an entry, (N, width), and the offset after it.

    expected: number of entries, if known; wording: of the error if it is another.
    """
    count, bracket, begin = _open(file, at)
    if not bracket:
        return np.empty((0, width)), begin
    if bracket == b"{":
        if expected is not None and count != expected:
            raise file.fail(wording.format(count, expected))
        if expected is None and count > AT_ONCE:
            raise file.fail(f"a uniform list of {count} entries; allowed: {AT_ONCE}")
        end = file.body.find(b"}", begin)
        value = _parsed(file, begin, end) if end >= 0 else np.empty(0)
        if value.size != width:
            raise file.fail(f"a uniform list of {value.size} numbers, expected {width}")
        return np.tile(value, (count, 1)), end + 1
    if file.binary and count:
        sizes = file.label_sizes if kind == "i" else file.scalar_sizes
        values, end = _raw(file, kind, sizes, count * width, begin)
        return values.reshape(count, width), end
    # entries of one number have no brackets of their own; a list of vectors is the last in a file
    end = file.body.find(b")", begin) if width == 1 else file.body.rfind(b")")
    stop = end if end >= begin else len(file.body)
    parts: Iterable[NDArray[np.generic]] = _parse(file, begin, stop)
    if kind == "i":
        parts = (as_integers(file, part) for part in parts)
    numbers = np.concatenate([np.empty(0, np.int32 if kind == "i" else np.float64), *parts])
    if count < 0:
        count = numbers.size // width
    if end < begin or numbers.size != count * width:
        raise file.fail(f"truncated or damaged: {numbers.size} numbers, expected {count * width}")
    return numbers.reshape(count, width), end + 1


def as_integers(file: FoamFile, values: NDArray[np.generic]) -> Labels:
    """Converts `values` to integers of the same shape, int32 if they fit; refuses 1.5 or 1e300."""
    numbers = np.asarray(values)
    if numbers.dtype.kind == "f":
        integers = numbers.astype(np.int64) if np.all(np.abs(numbers) < EXACT) else None
        if integers is None or np.any(integers != numbers):
            raise file.fail("a label is no whole number")
        numbers = integers
    return narrowed(numbers)


def scalars(file: FoamFile, parcels: int | None = None) -> Floats:
    """Reads a scalarField, (N,); parcels: N, if it is known."""
    if file.nothing:
        return np.empty(0)
    return _list(file, "f", 1, 0, parcels)[0].reshape(-1).astype(np.float64)


def vectors(file: FoamFile, parcels: int | None = None) -> Floats:
    """Reads a vectorField, (N, 3); parcels: N, if it is known."""
    if file.nothing:
        return np.empty((0, 3))
    return _list(file, "f", 3, 0, parcels)[0].astype(np.float64)


def labels(file: FoamFile, parcels: int | None = None) -> Labels:
    """Reads a labelList, (N,); parcels: N, if it is known."""
    return as_integers(file, _list(file, "i", 1, 0, parcels)[0].reshape(-1))


def faces(file: FoamFile) -> tuple[Labels, Labels]:
    """Corners of all faces of a faceList or faceCompactList, and the start of each, (F + 1,)."""
    if file.binary:
        start, end = _list(file, "i", 1, 0)
        corners, _ = _list(file, "i", 1, end)
        return as_integers(file, corners.reshape(-1)), as_integers(file, start.reshape(-1))
    count, _, begin = _open(file, 0)
    if not 0 <= count <= len(file.body):
        raise file.fail(f"truncated or damaged: {count} faces in {len(file.body)} bytes")
    parts = (as_integers(file, part) for part in _parse(file, begin, file.body.rfind(b")")))
    numbers = np.concatenate([np.empty(0, np.int32), *parts])
    if count and numbers.size % count == 0 and (width := numbers.size // count) > 1:
        table = numbers.reshape(count, width)
        if np.all(table[:, 0] == width - 1):  # all faces have as many corners: no need to walk
            return table[:, 1:].reshape(-1), np.arange(count + 1) * (width - 1)
    place = walk_faces(numbers)
    if len(place) != count + 1 or place[-1] != len(numbers):
        raise file.fail(f"truncated or damaged: {len(numbers)} numbers do not make {count} faces")
    keep = np.ones(len(numbers), dtype=bool)
    keep[place[:-1]] = False
    return numbers[keep], as_integers(file, place - np.arange(count + 1))


def internal_field(file: FoamFile, cells: int) -> tuple[AnyFloats, str | None]:
    """Reads the internalField (N,) of a volScalarField, of a mesh of `cells`, and its unit."""
    entries: dict[bytes, bytes] = {}
    at = top_level(file, 0, entries)
    nonuniform = None if at < 0 else _NONUNIFORM.match(file.body, at)
    if nonuniform is None:
        if b"internalField" not in entries:
            raise file.fail("has no internalField")
        value = expanded(file, entries[b"internalField"], entries)
        try:
            number = float(value.removeprefix(b"uniform"))
        except ValueError as error:
            shown = value[:40].decode("latin-1")
            way = "; write the number that `foamDictionary FILE -entry internalField` prints"
            allowed = (
                f"allowed: `uniform <number>`, or a list of numbers{way if b'#' in value else ''}"
            )
            raise file.fail(f"internalField is {shown!a}; {allowed}") from error
        if at >= 0:
            top_level(file, entry_end(file, at) + 1, entries)
        return np.full(cells, number), unit_of(file, entries)
    wording = "{} values, but the mesh has {} cells"
    stored, end = _list(file, "f", 1, nonuniform.end(), cells, wording)
    values = stored.reshape(-1).astype(stored.dtype.newbyteorder("="))  # as exact as it is written
    if len(values) != cells:
        raise file.fail(wording.format(len(values), cells))
    if b"dimensions" not in entries:
        top_level(file, entry_end(file, end) + 1, entries)
    return values, unit_of(file, entries)


def particles(file: FoamFile) -> Floats:
    """Positions of the parcels of a cloud, one row a parcel.

    (N, 4): x, y, z, cell; or (N, 7): four barycentric coordinates, cell, face and point of the
    tetrahedron. The rows decide, not the file's name: `positions` of OpenFOAM.org 5 and later is of
    the second kind.
    """
    if file.nothing:
        return np.empty((0, 4))
    count, bracket, begin = _open(file, 0)
    if count == 0:
        return np.empty((0, 4))
    if bracket != b"(" or count < 0:
        raise file.fail("a cloud cannot be a uniform list, or one without its length")
    if file.binary:
        return _binary_particles(file, count, begin)
    end = file.body.rfind(b")")
    numbers = _parsed(file, begin, end)
    for width in (4, 7):
        if numbers.size == count * width:
            return numbers.reshape(count, width)
    raise file.fail(
        f"truncated or damaged: {numbers.size} numbers for {count} parcels, expected 4 (position, "
        "cell) or 7 (barycentric coordinates, cell, face, point) for each"
    )


def _binary_particles(file: FoamFile, count: int, begin: int) -> Floats:
    """Records in brackets, each on its own line: scalars, then labels."""
    opening = file.body.find(b"(", begin)
    kinds = product(((3, 1), (4, 3)), file.scalar_sizes, file.label_sizes)
    for (reals, integers), scalar, label in kinds:
        size = reals * scalar + integers * label
        tail = file.body[opening + 1 + size : opening + 6 + size]
        gap = tail.find(b"(") if count > 1 else 1
        if tail[:1] != b")" or gap < 1:
            continue
        real, integer = f"{file.order}f{scalar}", f"{file.order}i{label}"
        fields = [("open", "S1"), ("reals", real, reals), ("integers", integer, integers)]
        if count * (size + 2) > len(file.body):
            continue
        record = np.dtype([*fields, ("close", "S1"), ("gap", f"V{gap - 1}")])
        # no gap follows the last record
        span = file.body[opening : opening + count * record.itemsize - gap + 1]
        span += b"\0" * (count * record.itemsize - len(span))
        rows = np.frombuffer(span, record, count)
        if np.all(rows["open"] == b"(") and np.all(rows["close"] == b")"):
            joined = np.concatenate([rows["reals"], rows["integers"]], axis=1)
            return joined.astype(np.float64)
    raise file.fail(f"truncated or damaged: no {count} binary parcels")
