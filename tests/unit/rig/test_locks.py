"""One lock for the machine, whatever the environment and the user of a process."""

from __future__ import annotations

import os
import subprocess
import sys
import uuid
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest

from cldit.rig import locks
from cldit.rig.errors import InUse
from tests.patience import HANG_s

# Each line asks for the instrument in a new process: with other variables, as another user.
ASKS = """
import os, sys, tempfile
from cldit.rig import locks
from cldit.rig.errors import InUse
for line in sys.stdin:
    address, uid, *variables = line.split()
    reader, writer = os.pipe()
    if os.fork() == 0:
        os.environ.update(variable.split("=") for variable in variables)
        tempfile.tempdir = None
        if int(uid) != os.getuid():
            os.setgid(int(uid)); os.setuid(int(uid))
        try:
            locks.take(address, 1)
            os.write(writer, b"taken")
        except InUse as error:
            os.write(writer, str(error).encode())
        os._exit(0)
    os.wait()
    print(os.read(reader, 1000).decode(), flush=True)
"""
NOBODY = 65534


@pytest.fixture
def address() -> Iterator[str]:
    name = f"test-{uuid.uuid4()}"
    yield name
    locks.lock_file(name).unlink(missing_ok=True)


def answers(lines: list[str]) -> list[str]:
    ran = subprocess.run(
        [sys.executable, "-c", ASKS], input="\n".join(lines), text=True, capture_output=True,
        timeout=HANG_s, check=True,
    )  # fmt: skip
    return ran.stdout.splitlines()


def requests(address: str, folder: Path) -> list[str]:
    """All combinations of three variables and, for root, of two users."""
    users = (0, NOBODY) if os.getuid() == 0 else (os.getuid(),)
    names = ("TMPDIR", "XDG_RUNTIME_DIR", "HOME")
    lines = []
    for user, changed in product(users, product((False, True), repeat=3)):
        variables = [f"{name}={folder}" for name, yes in zip(names, changed, strict=True) if yes]
        lines.append(f"{address} {user} {' '.join(variables)}")
    return lines


def test_one_lock_for_the_machine(address: str, tmp_path: Path) -> None:
    lines = requests(address, tmp_path)
    locks.take(address, 1)
    try:
        message = answers(lines)
    finally:
        locks.free(address, 1)
    assert len(message) == len(lines) >= 8
    assert all(f"is in use by process {os.getpid()} (" in part for part in message), message
    assert answers(lines) == ["taken"] * len(lines)  # it was freed, also by another user


def test_a_file_that_another_user_made_is_used(address: str) -> None:
    if os.getuid() != 0:
        pytest.skip("needs root, which can be another user")
    assert answers([f"{address} {NOBODY}"]) == ["taken"]
    locks.take(address, 1)
    assert "is in use" in answers([f"{address} {NOBODY}"])[0]
    locks.free(address, 1)


@pytest.mark.parametrize("kind", ["link", "hard link", "folder", "fifo"])
def test_what_a_stranger_put_there_is_named(kind: str, address: str, tmp_path: Path) -> None:
    """Nothing is written into what it leads to."""
    path, precious = locks.lock_file(address), path_beside(address)
    precious.write_text("precious")
    try:
        if kind == "link":
            path.symlink_to(precious)
        elif kind == "hard link":
            path.hardlink_to(precious)
        elif kind == "folder":
            path.mkdir()
        else:
            os.mkfifo(path)
        with pytest.raises(InUse, match=rf"cannot be locked: {path}, of the user .*removed$"):
            locks.take(address, 1)
        assert precious.read_text() == "precious"
    finally:
        precious.unlink()
        if kind == "folder":
            path.rmdir()


def path_beside(address: str) -> Path:
    return locks.lock_file(address).with_suffix(".precious")


def test_a_file_that_may_not_be_opened_is_named(address: str) -> None:
    if os.getuid() != 0:
        pytest.skip("needs root, which can be another user")
    path = locks.lock_file(address)
    path.touch(mode=0o600)
    (message,) = answers([f"{address} {NOBODY}"])
    assert message.startswith(
        f"cannot be locked: {path}, of the user with the number 0: Permission"
    )


def test_a_strangers_note_is_not_repeated(address: str) -> None:
    locks.take(address, 1)
    locks.lock_file(address).write_bytes(b"\x1b[2J\nrm -rf")
    assert answers([f"{address} {os.getuid()}"]) == [
        "is in use by another process; wait for it, or end it"
    ]
    locks.free(address, 1)
