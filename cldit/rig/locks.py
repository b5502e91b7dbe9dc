"""Locks of instruments, by address, for all processes and users of this machine.

A lock is held on a file that the system frees when its process ends, however it ends; the file has
who holds it, and since when, and is removed when it is freed. Its folder is the same for every user
and every environment: one in which all may make files, and nobody removes those of others. Within a
process every device may use an instrument that it holds.
"""

import os
import re
import shlex
import socket
import stat
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from cldit.rig.errors import InUse

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_FOLDERS = ("/run/lock", "/dev/shm", "/tmp")
_SHARED = stat.S_ISVTX | stat.S_IWOTH  # all may write into it, none may remove another's file
_MOST_LETTERS = 100  # of a command: one line of a terminal
_WAIT_s = 0.5  # until the system has freed the lock of a process that was killed


def tcp_address(host: str, port: int, part: str = "") -> str:
    """Address of an instrument in a network, the same by name and by number; `part`: of those at
    one address."""
    with suppress(OSError):
        host = socket.gethostbyname(host)
    return f"tcp {host} {port}" + (f" {part}" if part else "")


def serial_address(line: str) -> str:
    """Address of an instrument on a serial line, the same by any name of the line."""
    return f"serial {os.path.realpath(line) if os.sep in line else line}"


_HELD: dict[str, tuple[int, set[int]]] = {}
"""Handles of this process's locked files, and the devices that use each, by address."""
_GUARD = threading.Lock()


def take(address: str, user: object) -> None:
    """Locks an instrument for this process, on behalf of `user`, until `free`. Raises InUse, which
    names the process that has it, and since when.
    """
    with _GUARD:
        if address not in _HELD:
            _HELD[address] = _locked(lock_file(address)), set()
        _HELD[address][1].add(id(user))


def free(address: str, user: object) -> None:
    """Ends the use of an instrument by `user`; the last one's end frees the lock."""
    with _GUARD:
        if address not in _HELD:
            return
        handle, users = _HELD[address]
        users.discard(id(user))
        if not users:
            del _HELD[address]
            with suppress(OSError):  # another user's
                lock_file(address).unlink()
            os.close(handle)


def lock_file(address: str) -> Path:
    """File of the lock of an instrument."""
    name = f"cldit-{re.sub(r'[^A-Za-z0-9.]+', '-', address)}.lock"
    for folder in (os.environ.get("PROGRAMDATA", ""),) if fcntl is None else _FOLDERS:
        with suppress(OSError):
            if fcntl is None or os.stat(folder).st_mode & _SHARED == _SHARED:
                return Path(folder, name)
    raise InUse(f"cannot be locked: allowed: a folder for all users: {', '.join(_FOLDERS)}")


def _locked(path: Path) -> int:
    """Handle of a locked file; raises InUse."""
    end_s = time.monotonic() + _WAIT_s
    while True:
        handle = -1
        try:
            handle = _opened(path)
            _lock(handle)
            if os.stat(path).st_ino == os.fstat(handle).st_ino:  # else it was removed meanwhile
                break
            raise FileNotFoundError(path)
        except OSError as error:
            refusal = _refusal(path, handle, error)
            if handle >= 0:
                os.close(handle)
            if time.monotonic() >= end_s:
                raise refusal from None
            time.sleep(0.02)
    command = shlex.join([Path(sys.argv[0] or "python").name, *sys.argv[1:]])
    short = " ".join(command.split())[:_MOST_LETTERS]
    holder = f"process {os.getpid()} ({short}) since {time.strftime('%Y-%m-%d %H:%M:%S')}"
    with suppress(OSError):  # a full disk must not keep anybody from an instrument
        os.ftruncate(handle, 0)
        os.write(handle, holder.encode())
    return handle


def _opened(path: Path) -> int:
    """Handle of a file that all users may lock; raises OSError for anything but a plain file."""
    flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:  # without O_CREAT, which systems refuse for another user's file in such a folder
        handle = os.open(path, flags)
    except FileNotFoundError:
        handle = os.open(path, flags | os.O_CREAT | os.O_EXCL)
        with suppress(OSError):
            os.chmod(path, 0o666)
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
        os.close(handle)
        raise OSError("it is no plain file of its own")
    return handle


def _lock(handle: int) -> None:
    """Locks an open file; raises BlockingIOError if another process has it."""
    if fcntl is not None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return
    import msvcrt

    try:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except OSError as error:
        raise BlockingIOError(str(error)) from error


def _refusal(path: Path, handle: int, error: OSError) -> InUse:
    """The error of a lock that could not be taken."""
    if not isinstance(error, BlockingIOError):
        owner = ""
        with suppress(OSError):
            owner = f", of the user with the number {path.lstat().st_uid}"
        return InUse(f"cannot be locked: {path}{owner}: {error.strerror or error}; have it removed")
    with suppress(OSError, UnicodeDecodeError):
        if (holder := os.read(handle, 4 * _MOST_LETTERS).decode()).isprintable() and holder:
            return InUse(f"is in use by {holder}; wait for it, or end it")
    return InUse("is in use by another process; wait for it, or end it")
