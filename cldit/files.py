"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def fsync_folder(folder: Path) -> None:
    """Makes a rename in `folder` survive a power cut (where the system can: not on Windows)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def whole(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """Gives a path beside `path` to write to, which takes its place at the end.

    On an error, `path` is as it was, and nothing is left beside it. Processes and threads that
    write the same file do not meet: the last one stays.

    Args:
        path: of the file.
        sync: False for what can be made again: a power cut may leave it torn.

    Returns:
        The path to write to, in a context.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        yield part
        if sync:
            with part.open("r+b") as stream:
                os.fsync(stream.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    if sync:
        fsync_folder(path.parent)


def write_text(path: Path, text: str) -> None:
    """Writes `text` to `path`; the file appears whole or not at all."""
    with whole(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
