"""The one place where files are written and texts are read.

A file appears whole or not at all. What the system refuses becomes an error that names the path and
what to do; a test (tests/unit/test_one_place.py) keeps other modules from opening files to write.
"""

from __future__ import annotations

import errno
import io
import os
import re
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cldit.errors import DiskFull, FileError

MOST_TEXT_BYTES = 64_000_000  # of a file that people or cldit write by hand or as text

_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


@contextmanager
def written(where: Path, *, needed_bytes: int = 0) -> Iterator[None]:
    """Turns what the system says about a write into what to do about it.

    Args:
        where: path that errors name.
        needed_bytes: room that a full disk's error asks for.

    Raises:
        DiskFull: the disk, or the user's share of it, is full.
        FileError: any other failure of the system.
    """
    _check_name(where)
    try:
        yield
    except FileError:
        raise
    except OSError as error:
        if _number(error) in _FULL:
            raise DiskFull(
                f"{where}: the disk is full ({error.strerror or error}); free "
                f"{megabytes(needed_bytes)} and give the same command again, it resumes"
            ) from error
        raise FileError(f"{where}: cannot be written ({error.strerror or error})") from error


def _number(error: OSError) -> int | None:
    """The system's number of an error; HDF5 gives it in its text only."""
    told = re.search(r"errno = (\d+)", str(error)) if error.errno is None else None
    return error.errno if told is None else int(told[1])


def megabytes(size: int) -> str:
    """`size` bytes for people, 1 MB at least."""
    return f"{max(size, 1_000_000) / 1e6:.0f} MB"


def _check_name(path: Path) -> None:
    if "\0" in str(path):
        raise FileError(f"{str(path)!r}: holds a NUL byte, which no path may")


def fsync_folder(folder: Path) -> None:
    """Makes a rename in `folder` survive a power cut (where the system can: not on Windows)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def make_folder(path: Path) -> None:
    """Makes a folder and those above it, where they are not there yet.

    Raises:
        DiskFull, FileError: as `written`.
    """
    with written(path):
        path.mkdir(parents=True, exist_ok=True)


@contextmanager
def whole(path: Path, *, sync: bool = True, needed_bytes: int = 0) -> Iterator[Path]:
    """Gives a path beside `path` to write to, which takes its place at the end.

    On an error, `path` is as it was, and nothing is left beside it. Processes and threads that
    write the same file do not meet: the last one stays.

    Args:
        path: of the file.
        sync: False for what can be made again: a power cut may leave it torn.
        needed_bytes: room that a full disk's error asks for.

    Returns:
        The path to write to, in a context.

    Raises:
        DiskFull, FileError: as `written`.
    """
    with written(path, needed_bytes=needed_bytes):
        part = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
        try:
            yield part
            if sync:
                with part.open("r+b") as stream:
                    os.fsync(stream.fileno())
            part.replace(path)
        finally:
            with suppress(OSError):  # the first error is the one to tell
                part.unlink(missing_ok=True)
        if sync:
            fsync_folder(path.parent)


def write_bytes(path: Path, data: bytes | memoryview, *, sync: bool = True) -> None:
    """Writes `data` to `path`; the file appears whole or not at all.

    Args:
        path, sync: as in `whole`.
        data: all that the file holds.

    Raises:
        DiskFull, FileError: as `written`.
    """
    with whole(path, sync=sync, needed_bytes=len(data)) as part:
        part.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Writes `text` to `path` as UTF-8; raises as `write_bytes`."""
    write_bytes(path, text.encode())


def append_text(path: Path, text: str) -> None:
    """Adds `text` to the end of `path`, on the disk on return; all of it or nothing.

    Raises:
        DiskFull, FileError: as `written`.
    """
    with written(path), path.open("ab", buffering=0) as stream:
        end = stream.seek(0, os.SEEK_END)
        try:
            left = memoryview(text.encode())
            while left:
                left = left[stream.write(left) or 0 :]
            os.fsync(stream.fileno())
        except OSError:
            stream.truncate(end)
            raise


def open_regular(path: Path) -> io.BufferedReader:
    """Opens a regular file to read its bytes.

    It is opened without waiting: a pipe that nobody writes to would hold the reader for ever.

    Raises:
        FileError: missing, not a regular file, or not to be read.
    """
    _check_name(path)
    try:
        stream = open(path, "rb", opener=_without_waiting)
        mode = os.fstat(stream.fileno()).st_mode
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error})") from error
    kind = next((name for test, name in _KINDS if test(mode)), None)
    if kind is not None:
        stream.close()
        raise FileError(f"{path}: cannot be read (is {kind}; allowed is a regular file)")
    return stream


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def check_regular(path: Path) -> None:
    """Raises as `open_regular`: for libraries that open the file themselves."""
    open_regular(path).close()


def read_text(path: Path, *, most_bytes: int = MOST_TEXT_BYTES, encoding: str = "utf-8-sig") -> str:
    """The text of a regular file.

    Args:
        path: the file.
        most_bytes: that it may hold.
        encoding: UTF-8, with or without a byte order mark, where left out.

    Raises:
        FileError: as `open_regular`; too large, or not in this encoding.
    """
    with open_regular(path) as stream:
        try:
            data = stream.read(most_bytes + 1)
        except OSError as error:
            raise FileError(f"{path}: cannot be read ({error.strerror or error})") from error
    if len(data) > most_bytes:
        raise FileError(
            f"{path}: cannot be read (holds more than {most_bytes / 1e6:.0f} MB, for a text)"
        )
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        name = encoding.upper().removesuffix("-SIG")
        raise FileError(
            f"{path}: cannot be read (line {line}: byte 0x{data[error.start]:02x} is not {name}; "
            f"save it as {name})"
        ) from error
