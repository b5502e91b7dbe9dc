"""A second process that makes the rig safe when the first one dies, or cannot.

SIGKILL, or a computer out of memory, leaves no time to cool a black body. The guard holds one end
of a pipe; the other end closes when the acquiring process ends, however it ends. Unless that said
before that all is safe, the guard opens the rig file, makes every device safe, and says what it
did: in guard.log, in the journal, on the terminal, and by its exit status.
"""

import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO

from cldit.acquisition.journal import Journal
from cldit.acquisition.storage import GUARD, JOURNAL, RUNNING
from cldit.errors import ClditError
from cldit.io.exclusive import exclusive
from cldit.io.files import append_text
from cldit.io.plain_data import dump_yaml, parse_yaml
from cldit.io.terminal import warn
from cldit.rig.clock import Clock
from cldit.rig.link import CONNECT_s
from cldit.rig.load import Rig, open_rig
from cldit.rig.safety import RigSafety
from cldit.rig.stability import WATCH_s

_SAFE = b"safe\n"
_PAUSES_s = (0.0, 1.0, 10.0)  # before each attempt
# Each attempt watches until the black body cools, and reaches three instruments for 10 s each.
_WAIT_s = sum(_PAUSES_s) + len(_PAUSES_s) * (WATCH_s + 3 * CONNECT_s)
_PROCESS = (
    "import pathlib, sys; from cldit.acquisition.guard import watch; "
    "sys.exit(watch(sys.stdin.buffer, pathlib.Path(sys.argv[1])))"
)


class Guard:
    """Watches over `rig` while it is entered; has no process if all devices are simulated.

    `make_safe` must be called before it is left: otherwise, or if that failed, the guard's process
    takes over. guard.log and the journal are in `folder`.
    """

    def __init__(self, rig: Rig, folder: Path) -> None:
        self._rig = rig
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._safe = False

    def __enter__(self) -> "Guard":
        if all(device.identify().simulated for device in self._rig.devices.values()):
            return self
        rig_file = dump_yaml(self._rig.file.model_dump(mode="json"))
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROCESS, str(self._folder.resolve())],
            stdin=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C and a closed terminal are not for it
        )
        self._write(f"{len(rig_file.encode())}\n{rig_file}".encode())
        return self

    def make_safe(self) -> list[str]:
        """Makes the rig safe; what is still on afterwards, a line a device.

        Where the rig's own attempt fails, the devices are closed and the guard tries.
        """
        safety = self._rig.make_safe()
        _note(self._folder, safety, self._rig.clock.wall_time())
        problems = safety.problems
        if not problems:
            self._safe = True
            return safety.not_cooling  # the guard could do no more
        if self._process is None or self._process.stdin is None:
            return problems
        self._rig.close()  # one that is held could not be opened by the guard
        self._process.stdin.close()
        try:
            code = self._process.wait(_WAIT_s)
        except subprocess.TimeoutExpired:
            return [*problems, f"the guard still tries; see {self._folder / GUARD}"]
        if code == 0:
            return [*problems, "the guard then made every device safe, in a process of its own"]
        return [*problems, f"the guard could not help either; see {self._folder / GUARD}"]

    def _write(self, data: bytes) -> None:
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(data)
        self._process.stdin.flush()

    def __exit__(self, *_: object) -> None:
        if self._process is None or self._process.stdin is None:
            return
        if self._process.stdin.closed:  # it took over
            return
        try:
            if self._safe:
                self._write(_SAFE)
            self._process.stdin.close()
        except OSError:
            return  # it is gone, and there is nothing to guard any more
        self._process.wait(_WAIT_s)


def watch(stream: IO[bytes], folder: Path) -> int:
    """Runs the guard's process.

    `stream` delivers the rig file's length and text, then the acquisition's messages until it ends.
    The exit status is 0 if all is safe.
    """
    rig_file = stream.read(int(stream.readline() or 0))
    if stream.read() == _SAFE or not rig_file:
        return 0
    ended = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    log = [f"{ended} the acquisition ended unsafe; making the rig safe"]
    safety = RigSafety({}, [])
    for attempt, pause_s in enumerate(_PAUSES_s, start=1):
        time.sleep(pause_s)
        safety = _make_safe(rig_file)
        log += [f"{name}: {did}" for name, did in safety.did.items()]
        if not safety.problems:
            break
        log += [*safety.problems, f"attempt {attempt} of {len(_PAUSES_s)} failed"]
    problems = safety.unsafe
    log.append("NOT SAFE:\n" + "\n".join(problems) if problems else "every device is safe")
    with suppress(ClditError):  # a full disk must not keep the alarm
        append_text(folder / GUARD, "\n".join(log) + "\n")
    if problems:
        alarm(problems)
    # A folder in use: that process sees the rig itself.
    with suppress(ClditError), exclusive(folder, RUNNING):
        _note(folder, safety, Clock().wall_time())
    return int(bool(problems))


def alarm(problems: list[str]) -> None:
    """Prints to the terminal, where the error itself may not arrive."""
    warn("\a\ncldit: THE RIG IS NOT SAFE:\n" + "\n".join(problems))


def _note(folder: Path, safety: RigSafety, time: str) -> None:
    """Into the journal, where one was begun and anything was done."""
    if not safety.moved or not (folder / JOURNAL).exists():
        return
    with suppress(ClditError), Journal(folder / JOURNAL) as journal:  # guard.log has it too
        event = "unsafe" if safety.unsafe else "made safe"
        journal.append(event, time=time, did=safety.did, problems=safety.unsafe)


def _make_safe(rig_file: bytes) -> RigSafety:
    try:
        rig = open_rig(parse_yaml(rig_file.decode(), source="rig"))
    except ClditError as error:
        return RigSafety({}, [str(error)])
    safety = rig.make_safe(taken_over=True)
    return replace(safety, problems=safety.problems + rig.close())
