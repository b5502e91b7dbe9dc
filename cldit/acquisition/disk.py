"""Writing such that a kill, a power cut or a full disk leaves nothing incomplete."""

import os
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from cldit.errors import DiskFull
from cldit.io.data_streams import DataStream
from cldit.io.files import fsync_folder, megabytes

_OVERHEAD_bytes = 16_384  # TIFF header, metadata, journal lines of one shot


def needed_bytes(shots: int, *, picture_bytes: int) -> int:
    """Bytes that `shots` more images of `picture_bytes` each take, plus a tenth."""
    return int(1.1 * shots * (picture_bytes + _OVERHEAD_bytes))


def existing(folder: Path) -> Path:
    """`folder`, or its nearest existing parent."""
    return next(place for place in (folder, *folder.resolve().parents) if place.exists())


def free_bytes(folder: Path) -> int:
    """Bytes that are free on the disk of `folder`, which need not exist."""
    return shutil.disk_usage(existing(folder)).free


def check_room(folder: Path, needed: int) -> None:
    """Raises DiskFull if the disk of `folder`, existing or not, has fewer than `needed` bytes."""
    free = free_bytes(folder)
    if free < needed:
        raise DiskFull(
            f"{folder}: the plan needs {megabytes(needed)}, the disk has {free / 1e6:.0f} MB "
            "free; make room, or choose another folder"
        )


@contextmanager
def checked_stream(path: Path) -> Iterator[DataStream]:
    """Stream into a file that carries its own checksum; it is on the disk at the end.

    It is renamed before it is synced, so that the system can write data and entry in one go, which
    is three times as fast. A kill leaves the file complete or absent; a power cut before the end
    may leave it torn, which its reader detects by the checksum. A failure leaves nothing behind.
    """
    part = path.with_name(path.name + ".part")
    try:
        with DataStream(part) as stream:
            yield stream
        part.replace(path)
        with ThreadPoolExecutor(1) as pool:
            folder = pool.submit(fsync_folder, path.parent)
            with path.open("r+b") as stream_file:
                os.fsync(stream_file.fileno())
            folder.result()
    except OSError:
        for name in (part, path):
            with suppress(OSError):  # the first error is the one to tell
                name.unlink(missing_ok=True)
        raise
