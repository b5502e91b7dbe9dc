"""Input files of a CFD case: regular files that fit into memory; errors are `SprayError`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cldit.errors import FileError, SprayError
from cldit.io.extras import needed
from cldit.io.files import check_regular, read_text
from cldit.io.free_memory import free_bytes

AT_ONCE = 1 << 22  # bytes of a file, or rows of an array: some ten megabytes are in work
HEAD_BYTES = 10_000  # in which a header ends: OpenFOAM's has some 20 short lines, others fewer
_SHARE = 3  # text is held twice while it is put together, and its numbers beside it


def regular(path: Path) -> Path:
    """Returns `path` if it is a readable regular file; a pipe would block its reader."""
    try:
        check_regular(path)
    except FileError as error:
        raise SprayError(str(error)) from error
    return path


def module(name: str, path: Path) -> Any:
    """Imports a module of the extra `cfd` to read `path`."""
    return needed(name, extra="cfd", needed_by=f"{path}:", error=SprayError)


def text_of(path: Path) -> str:
    """Reads a file of text in UTF-8."""
    try:
        return read_text(path)
    except FileError as error:
        raise SprayError(str(error)) from error


def content(stream: Any, path: Path, size: int | None = None) -> bytes:
    """Reads `size` bytes, or all up to the end, once it is certain that they fit into memory.

    A packed file may unpack to a thousand times its size, and a damaged one may state any size.
    """
    free = free_bytes()
    limit = None if free is None else free // _SHARE
    parts: list[bytes] = []
    have = 0
    while size is None or have < size:
        part = stream.read(AT_ONCE if size is None else min(AT_ONCE, size - have))
        if not part:
            break
        parts.append(part)
        have += len(part)
        if limit is not None and have > limit:
            raise SprayError(
                f"{path}: more than {have / 1e9:.2g} GB of content; allowed: up to a third of the "
                f"{(free or 0) / 1e9:.2g} GB of memory that are free"
            )
    return b"".join(parts)


# Measured with `python -m tests.bench imports`: bytes in addition to the reader's.
_ROW = 160  # of a parcel or cell: ten doubles, twice while they are put together
WHILE_READING = {"xml": 1.4, "hdf": 2.0}  # that vtk takes at its peak for one that is stored
_ANYWAY = 200e6  # for some cells at a time, whatever the case


@dataclass(frozen=True)
class Size:
    """Counts of a case, and the bytes that its reader needs for mesh and fields at its peak."""

    cells: int
    parcels: int
    held_bytes: float

    @property
    def need_bytes(self) -> float:
        """Memory that the import takes at its peak."""
        return self.held_bytes + _ROW * (self.cells + self.parcels) + _ANYWAY


def check_room(source: Path, size: Size) -> None:
    """Refuses a case that needs more memory than is free; `source` names it."""
    free = free_bytes()
    if free is None or size.need_bytes <= free:
        return
    parcels = f" and {size.parcels} parcels" if size.parcels else ""
    raise SprayError(
        f"{source}: about {size.cells} cells{parcels} need some {size.need_bytes / 1e9:.2g} GB of "
        f"memory; {free / 1e9:.2g} GB are free. Close other programs; or export only the region "
        "around the spray (a clip or threshold on the fuel in ParaView); or run `cldit import CASE "
        "--out spray.npz` on a larger machine, and use spray.npz instead of the case"
    )
