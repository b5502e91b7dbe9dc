"""Writing of files and reading of texts, for the whole package.

A file appears whole or not at all. Errors of the system become errors that name the path and the
remedy; a test (tests/unit/test_one_place.py) keeps other modules from opening files to write.
"""

import codecs
import errno
import io
import os
import platform
import re
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cldit.errors import DiskFull, FileError

MOST_TEXT_BYTES = 64_000_000  # of a text file

_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
_HOST = re.sub(r"[^A-Za-z0-9]", "", platform.node()) or "here"
_SWEPT: set[Path] = set()
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


@contextmanager
def written(where: Path, *, needed_bytes: int = 0) -> Iterator[None]:
    """Turns errors of the system into DiskFull or FileError, which name the path and the remedy.

    needed_bytes: room that the error of a full disk asks for.
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
                f"{megabytes(needed_bytes)} and run the same command again, it resumes"
            ) from error
        raise FileError(f"{where}: cannot be written ({error.strerror or error})") from error


def _number(error: OSError) -> int | None:
    """Number of a system error; HDF5 has it only in its text."""
    match = re.search(r"errno = (\d+)", str(error)) if error.errno is None else None
    return error.errno if match is None else int(match[1])


def megabytes(size: int) -> str:
    """Text of a size in MB, at least 1 MB."""
    return f"{max(size, 1_000_000) / 1e6:.0f} MB"


def _check_name(path: Path) -> None:
    if "\0" in str(path):
        raise FileError(f"{str(path)!r}: contains a NUL byte, which is not allowed in a path")


def fsync_folder(folder: Path) -> None:
    """Makes a rename in a folder survive a power cut, except on Windows."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def make_folder(path: Path) -> None:
    """Makes a folder and its parents if they do not exist; raises as `written`."""
    with written(path):
        path.mkdir(parents=True, exist_ok=True)


@contextmanager
def whole(path: Path, *, sync: bool = True, needed_bytes: int = 0) -> Iterator[Path]:
    """Gives a temporary path to write to, which replaces `path` at the end; raises as `written`.

    On an error, `path` is unchanged, and the temporary file is removed. Processes and threads that
    write the same file do not interfere: the last one wins. Without `sync`, for files that can be
    made again, a power cut may leave it torn. `needed_bytes` is as for `written`.
    """
    with written(path, needed_bytes=needed_bytes):
        _sweep(path.parent)
        writer_id = f"{_HOST}-{os.getpid()}-{threading.get_ident()}"
        part = path.with_name(f"{path.name}.{writer_id}.part")
        try:
            yield part
            if sync:
                with part.open("r+b") as stream:
                    os.fsync(stream.fileno())
            part.replace(path)
        finally:
            with suppress(OSError):  # the first error is the one to report
                part.unlink(missing_ok=True)
        if sync:
            fsync_folder(path.parent)


def _sweep(folder: Path) -> None:
    """Removes what processes of this machine left that were killed; once in each folder."""
    if folder in _SWEPT or os.name == "nt":
        return
    _SWEPT.add(folder)
    for part in folder.glob(f"*.{_HOST}-*.part"):
        match = re.search(r"-(\d+)-\d+\.part$", part.name)
        if match is not None and not _lives(int(match[1])):
            with suppress(OSError):  # another process sweeps, too
                part.unlink()


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # of another user
        return True
    return True


def write_bytes(path: Path, data: bytes | memoryview, *, sync: bool = True) -> None:
    """Writes a file, which appears whole or not at all; raises as `written`."""
    with whole(path, sync=sync, needed_bytes=len(data)) as part:
        part.write_bytes(data)


def write_text(path: Path, content: str) -> None:
    """Writes a text as UTF-8; raises as `write_bytes`."""
    write_bytes(path, content.encode())


def append_text(path: Path, content: str) -> None:
    """Appends a text, all of it or nothing, synced to the disk; raises as `written`."""
    with written(path), path.open("ab", buffering=0) as stream:
        end = stream.seek(0, os.SEEK_END)
        try:
            remaining = memoryview(content.encode())
            while remaining:
                remaining = remaining[stream.write(remaining) or 0 :]
            os.fsync(stream.fileno())
        except OSError:
            stream.truncate(end)
            raise


def open_regular(path: Path) -> io.BufferedReader:
    """Opens a regular file to read its bytes; FileError if it is missing, special or unreadable,
    and from every read that fails.

    It is opened without blocking: a pipe without a writer would block for ever.
    """
    _check_name(path)
    with _readable(path):
        stream = _Regular(path, "rb", opener=_without_waiting)
        mode = os.fstat(stream.fileno()).st_mode
    kind = next((name for test, name in _KINDS if test(mode)), None)
    if kind is not None:
        stream.close()
        raise FileError(f"{path}: cannot be read (is {kind}; allowed: a regular file)")
    return io.BufferedReader(stream)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error})") from error


class _Regular(io.FileIO):
    """File whose failed reads, of a disk or a network drive, name it."""

    def readinto(self, buffer: Any) -> int | None:
        with _readable(Path(os.fsdecode(self.name))):
            return super().readinto(buffer)

    def readall(self) -> bytes:
        with _readable(Path(os.fsdecode(self.name))):
            return super().readall()


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def text_encoding(path: Path) -> str:
    """UTF-16 by its byte order mark; UTF-8 if all of the file is; else cp1252, as of spreadsheets
    on Windows. Raises FileError as `open_regular`.
    """
    decoder = codecs.getincrementaldecoder("utf-8")()
    with open_regular(path) as stream:
        part = stream.read(1 << 20)
        if part.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        try:
            while part:
                decoder.decode(part)
                part = stream.read(1 << 20)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return "cp1252"
    return "utf-8-sig"


def natural_order(path: Path) -> list[tuple[str, int]]:
    """Key that sorts names by the numbers in them: frame_2 before frame_10."""
    parts = re.split(r"(\d+)", str(path))
    numbers = [*parts[1::2], "-1"]
    key = [(word, int(number)) for word, number in zip(parts[::2], numbers, strict=True)]
    return [*key, (str(path), -1)]  # file_1 and file_01


def check_regular(path: Path) -> None:
    """Raises as `open_regular`, for libraries that open the file themselves."""
    open_regular(path).close()


def read_text(path: Path, *, most_bytes: int = MOST_TEXT_BYTES, encoding: str = "utf-8-sig") -> str:
    """Text of a regular file, in UTF-8 with or without a byte order mark by default.

    Raises FileError as `open_regular`, and if the file is too large or not in this encoding.
    """
    with open_regular(path) as stream:
        data = stream.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise FileError(f"{path}: cannot be read (more than {most_bytes / 1e6:.0f} MB, for a text)")
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        name = encoding.upper().removesuffix("-SIG")
        raise FileError(
            f"{path}: cannot be read (line {line}: byte 0x{data[error.start]:02x} is not {name}; "
            f"save it as {name})"
        ) from error
