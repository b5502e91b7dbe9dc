"""Files of an OpenFOAM case, ascii or binary, plain or gz, alone or collated: their headers.

Format after the OpenFOAM user guide ("File format") and output of v1912. `processorsN` folders of
collated cases hold one block for each processor (OpenFOAM's decomposedBlockData): the file's header
is followed by a List<char> for each processor: its number of bytes, `(`, the bytes, `)`. The first
block begins with the header of the content; the others have none (early versions gave each its
own).
"""

import gzip
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

from cldit.cfd.case import only_claimant
from cldit.cfd.inputs import HEAD_BYTES, content, regular
from cldit.errors import SprayError, reason
from cldit.io.files import open_regular

COLLATED = b"decomposedBlockData"
_NAME = re.compile(r"processors(\d+)(?:_(\d+)-(\d+))?$")
# blanks and comments; possessive, so that no part of it is tried twice
GAP = rb"(?:\s++|//[^\n]*+\n|/\*(?>.*?\*/))*+"
_BLOCK = re.compile(GAP + rb"(\d{1,18})\s*+\(", re.DOTALL)


@dataclass(frozen=True)
class Root:
    """Folder of a case, or of a processor's part of it; block: its number in collated files."""

    path: Path
    block: int | None = None

    def label(self, file: Path) -> str:
        """Name of a file in messages."""
        return str(file) if self.block is None else f"{file} (block {self.block})"


def split_roots(case: Path) -> list[Root]:
    """Parts of a decomposed case, by processor; empty if it is not decomposed."""
    single = sorted(case.glob("processor[0-9]*"), key=lambda folder: int(folder.name[9:]))
    folders = case.glob("processors[0-9]*")
    collated = [(folder, match) for folder in folders if (match := _NAME.match(folder.name))]
    if not collated:
        return [Root(folder) for folder in single]
    counts = {int(match.group(1)) for _, match in collated}
    names = ", ".join(sorted(folder.name for folder, _ in collated))
    if len(counts) > 1 or single:
        separate = f", and {single[0].name}" if single else ""
        raise SprayError(f"{case}: is decomposed in more than one way: {names}{separate}")
    parts: dict[int, Root] = {}
    for folder, match in collated:
        low = int(match.group(2) or 0)
        high = int(match.group(3)) if match.group(3) else int(match.group(1)) - 1
        parts |= {number: Root(folder, number - low) for number in range(low, high + 1)}
    count = counts.pop()
    if missing := sorted(set(range(count)) - set(parts)):
        raise SprayError(f"{case}: no folder for processor {missing[0]} of {count}; it has {names}")
    return [parts[number] for number in range(count)]


def block_of(stream: BinaryIO, at: int, path: Path, block: int) -> tuple[bytes, bytes]:
    """Reads the first block and the block `block` of a collated file whose header ends `at`."""
    first_block = inside = b""
    for number in range(block + 1):
        stream.seek(at)
        match = _BLOCK.match(stream.read(HEAD_BYTES))
        if match is None:
            raise SprayError(
                f"{path}: truncated, or of fewer processors: {number} blocks, no block {block}"
            )
        size, begin = int(match.group(1)), at + match.end()
        stream.seek(begin)
        if number in (0, block):
            inside = content(stream, path, size)
            first_block = inside if number == 0 else first_block
        else:
            stream.seek(begin + size)
        if stream.read(1) != b")":
            raise SprayError(
                f"{path}: truncated or damaged: block {number} does not end after {size} bytes"
            )
        at = begin + size + 1
    return first_block, inside


_HEADER = re.compile(rb"FoamFile\s*\{(.*?)\}", re.DOTALL)
TIME = re.compile(r"-?\d+(\.\d*)?([eE][+-]?\d+)?$")  # name of the folder of a time


@dataclass(frozen=True)
class FoamFile:
    """Content of a file after its header; sizes in bytes, several if the header states none."""

    path: Path
    binary: bool
    order: str
    label_sizes: tuple[int, ...]
    scalar_sizes: tuple[int, ...]
    body: bytes
    block: int | None = None  # of a collated file
    kind: str = ""  # class in the header, such as scalarField
    time_s: float | None = None  # by the header's location

    @property
    def nothing(self) -> bool:
        """True for an empty block; collated files have one for a processor without content."""
        return self.block is not None and not self.body.strip()

    def fail(self, problem: str) -> SprayError:
        """Error that names the file."""
        where = "" if self.block is None else f", block {self.block}"
        return SprayError(f"{self.path}{where}: {problem}")


def find_foam(path: Path) -> Path | None:
    """Path of the file or of its .gz form, whichever exists; both are an error."""
    packed = path.with_name(path.name + ".gz")
    files = [file for file in (path, packed) if file.is_file()]
    return only_claimant(str(path), files) if files else None


@contextmanager
def open_foam(path: Path) -> Iterator[BinaryIO]:
    """Opens a file, plain or .gz; errors while it is read become `SprayError`."""
    try:
        regular(path)
        with gzip.open(path) if path.suffix == ".gz" else open_regular(path) as stream:
            yield cast(BinaryIO, stream)
    except (OSError, EOFError, zlib.error) as error:
        raise SprayError(f"{path}: cannot be read ({reason(error)})") from error


def read_foam(path: Path, block: int | None = None) -> FoamFile:
    """Reads a file by its plain name, or its `.gz` form; `block`: processor in a collated file."""
    existing = find_foam(path)
    if existing is None:
        raise SprayError(f"{path}: is missing (also as .gz)")
    with open_foam(existing) as stream:
        entries, body = _content(stream, existing, block)
    arch_text = entries.get(b"arch", b"").decode("latin-1")
    binary = entries.get(b"format", b"ascii").strip() == b"binary"
    location = entries.get(b"location", b"").decode("latin-1").strip('" ').partition("/")[0]
    label = re.search(r"label=(\d+)", arch_text)
    scalar = re.search(r"scalar=(\d+)", arch_text)
    return FoamFile(
        path=existing,
        binary=binary,
        order=">" if "MSB" in arch_text else "<",
        label_sizes=(int(label.group(1)) // 8,) if label else (4, 8),
        scalar_sizes=(int(scalar.group(1)) // 8,) if scalar else (8, 4),
        body=body if binary else without_comments(body),
        block=block,
        kind=entries.get(b"class", b"").decode("latin-1").strip(),
        time_s=float(location) if TIME.match(location) else None,
    )


def _content(stream: BinaryIO, path: Path, block: int | None) -> tuple[dict[bytes, bytes], bytes]:
    """Entries of the header, and the rest; of a collated file, those of a block."""
    entries, end = _head(stream.read(HEAD_BYTES), path)
    collated = entries.get(b"class", b"").strip() == COLLATED
    if collated != (block is not None):
        state = "is collated, but not in" if collated else "is not collated, but in"
        raise SprayError(f"{path}: {state} a folder processorsN")
    if block is None:
        stream.seek(end)
        return entries, content(stream, path)
    arch = entries.get(b"arch")
    first_block, body = block_of(stream, end, path, block)
    entries, end = _head(first_block[:HEAD_BYTES], path)
    if block == 0:
        body = first_block[end:]
    elif _HEADER.search(body[:HEAD_BYTES]):
        entries, end = _head(body[:HEAD_BYTES], path)
        body = body[end:]
    if arch is not None:
        entries.setdefault(b"arch", arch)
    return entries, body


def _head(text: bytes, path: Path) -> tuple[dict[bytes, bytes], int]:
    """Entries of the header, and the offset of its end."""
    head = _HEADER.search(without_comments(text))
    if head is None:
        raise SprayError(f"{path}: is not an OpenFOAM file (no FoamFile header)")
    return dict(re.findall(rb'(\w++)\s++("[^"]*+"|[^;]++);', head.group(1))), head.end()


def without_comments(text: bytes) -> bytes:
    """Blanks the comments outside quotes, without a change of length."""
    parts: list[bytes] = []
    begin = at = 0
    while (at := text.find(b"/", at)) >= 0:
        line = text[at : at + 2] == b"//"
        quoted = text.count(b'"', max(begin, text.rfind(b"\n", begin, at)), at) % 2
        if quoted or not (line or text[at : at + 2] == b"/*"):
            at += 1
            continue
        stop = text.find(b"\n" if line else b"*/", at + 2)
        end = len(text) if stop < 0 else stop + (0 if line else 2)
        parts += [text[begin:at], b" " * (end - at)]
        begin = at = end
    return b"".join([*parts, text[begin:]]) if parts else text
