"""Aravis' simulated camera (Debian: aravis-tools)."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

_PROGRAM = "arv-fake-gv-camera-0.8"


@contextmanager
def aravis_peer(lost_per_thousand: int = 0) -> Iterator[str]:
    """Address of Aravis' camera, which loses so many packets of its pictures."""
    program = shutil.which(_PROGRAM)
    if program is None:
        pytest.skip(f"{_PROGRAM} is missing; install aravis-tools")
    with subprocess.Popen([program, "-i", "127.0.0.1", "-r", str(lost_per_thousand)]) as process:
        time.sleep(0.5)
        try:
            yield "127.0.0.1"
        finally:
            process.terminate()
