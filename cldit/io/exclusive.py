"""Folders into which one process, and one thread of it, writes at a time."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from cldit.errors import RunFolderError
from cldit.io.files import make_folder, written

LOCK = ".lock"  # stays in the folder; the system frees it when its process ends, however it ends

_MINE: set[tuple[Path, int]] = set()  # folders held by this process, and by which thread


def is_empty(folder: Path) -> bool:
    """True if nothing exists at a path, or a folder that contains at most a lock."""
    if not folder.is_dir():
        return not folder.exists()
    return all(entry.name == LOCK for entry in folder.iterdir())


@contextmanager
def exclusive(folder: Path, writer: str, *, nested: bool = False) -> Iterator[None]:
    """Locks a folder against others that write to it.

    `writer` names the work in the message; with `nested`, a thread that has the lock already goes
    on. Raises RunFolderError if it is locked or cannot be made.
    """
    new = not folder.exists()
    make_folder(folder)
    key = (folder.resolve(), threading.get_ident())
    if nested and key in _MINE:
        yield
        return
    lock = FileLock(folder / LOCK)
    with written(folder):
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise RunFolderError(
                f"{folder}: another {writer} is running here; wait for it or choose another folder"
            ) from None
    _MINE.add(key)
    try:
        yield
    finally:
        _MINE.discard(key)
        if new and is_empty(folder):  # nothing was written
            with suppress(OSError):
                (folder / LOCK).unlink()
                folder.rmdir()
        lock.release()
