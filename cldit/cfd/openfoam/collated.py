"""Collated OpenFOAM cases: `processorsN` folders whose files hold one block for each processor.

Format after OpenFOAM's decomposedBlockData: the file's header is followed by a List<char> for each
processor: its number of bytes, `(`, the bytes, `)`. The first block begins with the header of the
content; the others have none (early versions gave each its own).
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from cldit.cfd.inputs import HEAD_BYTES, content
from cldit.errors import SprayError

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
