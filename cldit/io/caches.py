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

_PROBE = bytes(4096)  # a full disk has room for a name, not for content


def default_cache() -> Path:
    """Folder in which cldit keeps tables, sprays and runs."""
    use_caches()
    return _own()


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
    root = _own().parent
    named = {
        "POCL_CACHE_DIR": root / "pocl",  # PoCL looks at XDG_CACHE_HOME and HOME, in this order
        "MPLCONFIGDIR": Path(platformdirs.user_config_dir("matplotlib", appauthor=False)),
        "NUMBA_CACHE_DIR": root / "numba",
    }
    for name, usual in named.items():
        given = os.environ.get(name)
        if given is not None and not _can_be_written(Path(given)):
            logging.getLogger("cldit").warning("%s: %s cannot be written", name, given)
            given = None
        elif given is None and _own() == own and name != "MPLCONFIGDIR":
            continue  # what the library does by itself is right
        if given is None and not _can_be_written(usual):
            os.environ[name] = str(_made(root / name.lower()))
        elif given is None and name != "MPLCONFIGDIR":
            os.environ[name] = str(usual)


def _own() -> Path:
    """On all systems: a folder named in XDG_CACHE_HOME goes before the system's own."""
    named = os.environ.get("XDG_CACHE_HOME")
    if named:
        return Path(named) / "cldit"
    return Path(platformdirs.user_cache_dir("cldit", appauthor=False))


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as stream:
            stream.write(_PROBE)
            stream.flush()
    except (OSError, ValueError):
        return False
    return True


def _made(folder: Path) -> Path:
    if not _can_be_written(folder):
        raise FileError(f"{folder}: cannot be written; set XDG_CACHE_HOME to a folder for caches")
    return folder


def _temporary(own: Path) -> Path:
    """One a user, kept for the next process; nobody else can have put anything into it."""
    try:
        place = Path(tempfile.gettempdir()) / f"cldit-cache-{getattr(os, 'getuid', int)()}"
        place.mkdir(mode=0o700, exist_ok=True)
        status = place.lstat()
        mine = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
        mine = mine and status.st_uid == getattr(os, "getuid", lambda: status.st_uid)()
        if not mine and os.name != "nt":
            place = Path(tempfile.mkdtemp(prefix="cldit-cache-"))
        reason = "" if _can_be_written(place) else f"{place} cannot be written"
    except OSError as error:
        reason = error.strerror or str(error)
    if reason:
        raise FileError(
            f"{own}: caches cannot be kept here, nor in a temporary folder ({reason}); make room, "
            "or set XDG_CACHE_HOME to a folder for caches"
        )
    return place
