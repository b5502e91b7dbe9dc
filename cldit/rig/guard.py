"""A second process that makes the rig safe when the first one dies.

SIGKILL, or a computer out of memory, leaves no time to cool a black body. The guard holds one end
of a pipe; the other end closes when the acquiring process ends, however it ends. Unless that said
before that all is safe, the guard opens the rig file, makes every device safe, and writes what it
did beside the journal.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType

import yaml

from cldit.errors import ClditError
from cldit.rig.load import Rig, open_rig

_SAFE = b"safe\n"
_CONNECT_s = 15.0  # longer than any camera's heartbeat
_TRIES = 3


class Guard:
    """Watches over `rig` while it is entered; does nothing where all devices are simulated.

    Args:
        log: the file into which the guard writes if it had to act.
    """

    def __init__(self, rig: Rig, log: Path) -> None:
        self._rig = rig
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Guard:
        if all(device.identify().simulated for device in self._rig.devices.values()):
            return self
        rig_file = yaml.safe_dump(self._rig.file.model_dump(mode="json"))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cldit.rig.guard", str(self._log.resolve())],
            stdin=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C and a closed terminal are not for it
        )
        assert self._process.stdin is not None
        self._process.stdin.write(f"{len(rig_file.encode())}\n{rig_file}".encode())
        self._process.stdin.flush()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._process is None or self._process.stdin is None:
            return
        try:
            self._process.stdin.write(_SAFE)
            self._process.stdin.close()
        except OSError:
            return  # it is gone, and there is nothing to guard any more
        self._process.wait(10.0)


def _watch(log: Path) -> int:
    stream = sys.stdin.buffer
    rig_file = stream.read(int(stream.readline() or 0))
    if stream.read() == _SAFE or not rig_file:
        return 0
    lines = [f"{time.strftime('%Y-%m-%dT%H:%M:%S%z')} the acquisition died; making the rig safe"]
    for attempt in range(1, _TRIES + 1):
        problems = _make_safe(rig_file)
        lines += problems or ["every device is safe"]
        if not problems:
            break
        lines.append(f"attempt {attempt} of {_TRIES} failed")
    with log.open("a", encoding="utf-8") as out:
        out.write("\n".join(lines) + "\n")
        out.flush()
        os.fsync(out.fileno())
    return int(bool(problems))


def _make_safe(rig_file: bytes) -> list[str]:
    """Each device by itself, the trigger first: one that is dead must not keep the others hot."""
    try:
        rig = open_rig(yaml.safe_load(rig_file))
    except ClditError as error:
        return [str(error)]
    problems: list[str] = []
    for name, device in reversed(rig.devices.items()):
        try:
            device.connect(_CONNECT_s)
            device.make_safe()
        except Exception as error:  # as above
            problems.append(f"{name}: {error}")
    return problems + rig.close()


if __name__ == "__main__":
    sys.exit(_watch(Path(sys.argv[1])))
