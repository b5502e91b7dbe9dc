"""`cldit acquire` at a terminal that takes nothing (Ctrl-S): the recording goes on without it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import yaml

from cldit.acquisition import Plan, open_acquisition
from tests.journals import read_journal
from tests.patience import HANG_s, until

termios = pytest.importorskip("termios")


def _events(folder: Path) -> list[str]:
    return [entry["event"] for entry in read_journal(folder / "journal.jsonl")]


def test_a_recording_does_not_wait_for_its_terminal(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(tiny_rig), encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(tiny_plan.dump(), encoding="utf-8")
    folder = tmp_path / "shots"
    ours, terminal = os.openpty()
    shown: list[bytes] = []
    reader = threading.Thread(target=_read, args=(ours, shown), daemon=True)
    try:
        termios.tcflow(terminal, termios.TCOOFF)
        process = subprocess.Popen(
            [sys.executable, "-m", "cldit", "acquire", "rig.yaml", "plan.yaml", "--out", folder],
            cwd=tmp_path,
            stdin=terminal,
            stdout=terminal,
            stderr=terminal,
            env=os.environ | {"TERM": "xterm", "COLUMNS": "100", "LINES": "30"},
        )
        try:
            until(
                lambda: process.poll() is not None or "finished" in _events(folder),
                lambda: _events(folder),
            )
            assert process.poll() is None, os.read(ours, 65536).decode(errors="replace")
            opened = open_acquisition(folder)
            assert opened.complete and len(opened.shots) == len(tiny_plan.steps())
            reader.start()
            termios.tcflow(terminal, termios.TCOON)
            assert process.wait(HANG_s) == 0
        finally:
            process.kill()
            process.wait()
    finally:
        os.close(terminal)
        if reader.is_alive():
            reader.join(HANG_s)
        os.close(ours)
    assert f"{len(tiny_plan.steps())} of {len(tiny_plan.steps())} shots" in b"".join(shown).decode()


def _read(terminal: int, into: list[bytes]) -> None:
    """Until nobody holds its other side any more."""
    try:
        while data := os.read(terminal, 65536):
            into.append(data)
    except OSError:  # Linux says so with an error
        return
