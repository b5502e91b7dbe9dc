"""The one place for caches: cldit's own, and those of the libraries that it uses.

Containers and clusters run programs as users without a home that can be written. PoCL then says
that there is no platform, pyopencl ends with an AttributeError, numba refuses to compile. So the
folders are tried before any of them is imported, and where they cannot be written all caches go
into one temporary folder, and a line says so.
"""

from __future__ import annotations

import logging
import os
import stat
import tempfile
from functools import cache
from pathlib import Path

import platformdirs

from cldit.errors import FileError

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
    """Gives every library a folder for its cache that can be written; once a process.

    A folder that can be written, or that the user named, stays as it is.

    Raises:
        FileError: there is no such folder, not even a temporary one.
    """
    own = _own()
    if not _can_be_written(own):
        place = _temporary(own)
        os.environ["XDG_CACHE_HOME"] = str(place)
        logging.getLogger("cldit").warning(
            "%s: caches cannot be kept here, so they are in %s; XDG_CACHE_HOME names another "
            "folder",
            own,
            place,
        )
    moved, root = _own() != own, _own().parent
    config = Path(platformdirs.user_config_dir("matplotlib", appauthor=False))
    _choose("POCL_CACHE_DIR", root / "pocl", own, size=_POCL_BYTES)
    _choose("MPLCONFIGDIR", config, own)
    if moved or "NUMBA_CACHE_DIR" in os.environ:  # else numba writes beside the code
        os.environ.setdefault("NUMBA_CACHE_DIR", str(root / "numba"))
        _choose("NUMBA_CACHE_DIR", root / "numba", own)


def _choose(name: str, usual: Path, own: Path, *, size: int = _PROBE_BYTES) -> None:
    """Sets a library's variable to a folder that can be written, where its own cannot be."""
    given = os.environ.get(name)
    refused = usual if given is None else Path(given)
    if _can_be_written(refused, size):
        return
    near = (usual, _own().parent / name.lower())
    place = next((folder for folder in near if _can_be_written(folder, size)), None)
    if place is None:
        place = _temporary(own, size) / name.lower()
    os.environ[name] = str(place)
    if given is not None or name == "POCL_CACHE_DIR":
        logging.getLogger("cldit").warning(
            "%s: %s cannot be written or is full, so this cache is in %s", name, refused, place
        )


def _own() -> Path:
    """On all systems: a folder named in XDG_CACHE_HOME goes before the system's own."""
    named = os.environ.get("XDG_CACHE_HOME")
    if named:
        return Path(named) / "cldit"
    return Path(platformdirs.user_cache_dir("cldit", appauthor=False))


def probe(folder: Path, size: int) -> None:
    """Writes `size` bytes into a folder, which is made if need be, and removes them.

    Raises:
        OSError: it cannot be written, or has no room for them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as stream:
        stream.write(bytes(size))
        stream.flush()


def _can_be_written(folder: Path, size: int = _PROBE_BYTES) -> bool:
    try:
        probe(folder, size)
    except (OSError, ValueError):
        return False
    return True


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
        reason = "" if _can_be_written(place, size) else f"{place} cannot be written or is full"
    except OSError as error:
        reason = error.strerror or str(error)
    if reason:
        raise FileError(
            f"{own}: caches cannot be kept here, nor in a temporary folder ({reason}); make room, "
            "or set XDG_CACHE_HOME to a folder for caches"
        )
    return place
