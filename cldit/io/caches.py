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
_PROBE_BYTES = 4096  # a full disk has room for a name, not for content
_POCL_BYTES = 4_000_000  # of a scene's kernels, several times over


def default_cache() -> Path:
    """Folder in which cldit keeps tables, sprays and runs."""
    use_caches()
    return _own()


def pocl_cache() -> Path:
    """Folder in which PoCL keeps compiled kernels."""
    named = os.environ.get("POCL_CACHE_DIR")
    return Path(named) if named else _own().parent / "pocl"


@cache
def use_caches() -> None:
    """Gives every library a folder for its cache that can be written; once in a process.

    Folders that can be written stay as they are. Raises FileError if no folder can be.
    """
    own = _own()
    if not _can_be_written(own):
        place = _temporary(own)
        os.environ["XDG_CACHE_HOME"] = str(place)
        message = "%s: caches cannot be kept here, so they are in %s; or set XDG_CACHE_HOME"
        _LOG.warning(message, own, place)
    _choose("POCL_CACHE_DIR", _own().parent / "pocl", own, size=_POCL_BYTES)
    config = platformdirs.user_config_dir("matplotlib", appauthor=False)
    _choose("MPLCONFIGDIR", Path(config), own)


def _choose(name: str, usual: Path, own: Path, *, size: int = _PROBE_BYTES) -> None:
    """Sets a library's variable to a folder that can be written, where its own cannot be."""
    given = os.environ.get(name)
    refused = usual if given is None else Path(given)
    if _can_be_written(refused, size):
        return
    near = (usual, _own().parent / name.lower())
    found = next((folder for folder in near if _can_be_written(folder, size)), None)
    place = found or _temporary(own, size) / name.lower()
    os.environ[name] = str(place)
    if given is not None or name == "POCL_CACHE_DIR":
        message = "%s: %s cannot be written or is full, so this cache is in %s"
        _LOG.warning(message, name, refused, place)


def _own() -> Path:
    """Folder in XDG_CACHE_HOME on all systems if it is set, else the system's own."""
    named = os.environ.get("XDG_CACHE_HOME")
    usual = platformdirs.user_cache_dir("cldit", appauthor=False)
    return Path(named) / "cldit" if named else Path(usual)


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


def _temporary(own: Path, size: int = _PROBE_BYTES) -> Path:
    """One a user, kept for the next process; nobody else can have put anything into it."""
    try:
        place = Path(tempfile.gettempdir()) / f"cldit-cache-{getattr(os, 'getuid', int)()}"
        place.mkdir(mode=0o700, exist_ok=True)
        status = place.lstat()
        mine = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
        mine = mine and status.st_uid == getattr(os, "getuid", lambda: status.st_uid)()
        if not mine and os.name != "nt":
            place = Path(tempfile.mkdtemp(prefix="cldit-cache-"))
        probe(place, size)
    except OSError as error:
        raise FileError(
            f"{own}: caches cannot be kept here, nor in a temporary folder "
            f"({error.strerror or error}); make room, or set XDG_CACHE_HOME to a folder for caches"
        ) from error
    return place
