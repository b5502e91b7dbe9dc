"""Locks of instruments, by address, for all processes of a user on this machine.

The lock is a file that the system frees when its process ends, however it ends; beside it is who
holds it, and since when. Within a process every device may use an instrument that it holds.
"""

import os
import re
import shlex
import socket
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from filelock import FileLock, Timeout

from cldit.errors import ClditError
from cldit.io.caches import runtime_folder
from cldit.io.files import write_text
from cldit.io.plain_data import dump_yaml, read_mapping
from cldit.rig.errors import InUse

_MOST_LETTERS = 100  # of a command
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


@dataclass
class _Held:
    """Lock of this process, and the devices that use it."""

    lock: FileLock
    users: set[int] = field(default_factory=set)


_HELD: dict[str, _Held] = {}
_GUARD = threading.Lock()


def take(address: str, user: object) -> None:
    """Locks an instrument for this process, on behalf of `user`, until `free`. Raises InUse, which
    names the process that has it, and since when.
    """
    with _GUARD:
        held = _HELD.get(address)
        if held is None:
            held = _HELD[address] = _Held(_locked(address))
        held.users.add(id(user))


def free(address: str, user: object) -> None:
    """Ends the use of an instrument by `user`; the last one's end frees the lock."""
    with _GUARD:
        held = _HELD.get(address)
        if held is None:
            return
        held.users.discard(id(user))
        if not held.users:
            del _HELD[address]
            held.lock.release()


def _locked(address: str) -> FileLock:
    folder = runtime_folder() / "instruments"
    folder.mkdir(parents=True, exist_ok=True)
    name = re.sub(r"[^A-Za-z0-9.]+", "-", address)
    lock, note = FileLock(folder / f"{name}.lock", thread_local=False), folder / f"{name}.yaml"
    try:
        lock.acquire(timeout=_WAIT_s, poll_interval=0.02)
    except Timeout:
        raise InUse(f"is in use by {_holder(note)}; wait for it, or end it") from None
    command = shlex.join([Path(sys.argv[0] or "python").name, *sys.argv[1:]])
    mine = {
        "pid": os.getpid(),
        "since": time.strftime("%Y-%m-%d %H:%M:%S"),
        "command": " ".join(command.split())[:_MOST_LETTERS],
    }
    with suppress(ClditError):  # a full disk must not keep anybody from an instrument
        write_text(note, dump_yaml(mine))
    return lock


def _holder(note: Path) -> str:
    """The process that holds a lock, in words."""
    try:
        known = read_mapping(note)
        return f"process {known['pid']} ({known['command']}) since {known['since']}"
    except (ClditError, KeyError):
        return "another process"
