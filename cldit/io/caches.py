"""The one place for caches: cldit's own, and those of the libraries that it uses.

Users of containers and clusters may have no home that can be written, and libraries fail there. So
folders are tried before libraries are imported, and replaced by a temporary one, with a warning.
"""

from __future__ import annotations

import logging
import os
import stat
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

import platformdirs

from cldit.errors import FileError

_LOG = logging.getLogger("cldit")
_PROBE_BYTES = 4096  # a block of a file system: a full disk has room for a name, not for it
_POCL_BYTES = 4_000_000  # of a scene's kernels, several times over


def default_cache() -> Path:
    """Folder in which cldit keeps tables, sprays and runs."""
    use_caches()
    return _cldit_cache()


def pocl_cache() -> Path:
    """Folder in which PoCL keeps compiled kernels."""
    named = os.environ.get("POCL_CACHE_DIR")
    return Path(named) if named else _cldit_cache().parent / "pocl"


@cache
def use_caches() -> None:
    """Gives every library a folder for its cache that can be written; once in a process.

    Folders that can be written stay as they are. Raises FileError if no folder can be.
    """
    cache_folder = _cldit_cache()
    if not _can_be_written(cache_folder):
        place = _temporary(cache_folder)
        os.environ["XDG_CACHE_HOME"] = str(place)
        message = "%s: caches cannot be kept here, so they are in %s; or set XDG_CACHE_HOME"
        _LOG.warning(message, cache_folder, place)
    _choose("POCL_CACHE_DIR", _cldit_cache().parent / "pocl", cache_folder, size=_POCL_BYTES)
    config = platformdirs.user_config_dir("matplotlib", appauthor=False)
    _choose("MPLCONFIGDIR", Path(config), cache_folder)


def _choose(
    name: str, default_folder: Path, cache_folder: Path, *, size: int = _PROBE_BYTES
) -> None:
    """Sets a library's variable to a folder that can be written, where its own cannot be."""
    setting = os.environ.get(name)
    refused = default_folder if setting is None else Path(setting)
    if _can_be_written(refused, size):
        return
    candidates = (default_folder, _cldit_cache().parent / name.lower())
    writable = next((folder for folder in candidates if _can_be_written(folder, size)), None)
    place = writable or _temporary(cache_folder, size) / name.lower()
    os.environ[name] = str(place)
    if setting is not None or name == "POCL_CACHE_DIR":
        message = "%s: %s cannot be written or is full, so this cache is in %s"
        _LOG.warning(message, name, refused, place)


def _cldit_cache() -> Path:
    """Folder in XDG_CACHE_HOME on all systems if it is set, else the system's own."""
    named = os.environ.get("XDG_CACHE_HOME")
    default_folder = platformdirs.user_cache_dir("cldit", appauthor=False)
    return Path(named) / "cldit" if named else Path(default_folder)


def probe(folder: Path, size: int) -> None:
    """Writes `size` bytes into a folder and removes them; raises OSError without room for them."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as stream:
        stream.write(bytes(size))
        stream.flush()


def _can_be_written(folder: Path, size: int = _PROBE_BYTES) -> bool:
    with suppress(OSError, ValueError):
        probe(folder, size)
        return True
    return False


def _temporary(cache_folder: Path, size: int = _PROBE_BYTES) -> Path:
    """Temporary folder of the user, kept for the next process; no other user can write to it."""
    try:
        place = Path(tempfile.gettempdir()) / f"cldit-cache-{getattr(os, 'getuid', int)()}"
        place.mkdir(mode=0o700, exist_ok=True)
        status = place.lstat()
        is_private = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
        is_private = is_private and status.st_uid == getattr(os, "getuid", lambda: status.st_uid)()
        if not is_private and os.name != "nt":
            place = Path(tempfile.mkdtemp(prefix="cldit-cache-"))
        probe(place, size)
    except OSError as error:
        raise FileError(
            f"{cache_folder}: caches cannot be kept here, nor in a temporary folder "
            f"({error.strerror or error}); make room, or set XDG_CACHE_HOME to a folder for caches"
        ) from error
    return place
