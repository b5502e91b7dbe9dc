"""Free memory: what the kernel says, control groups, and ulimit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cldit.io import free_memory

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="nobody says what is free elsewhere"
)


def test_no_more_than_there_is() -> None:
    free = free_memory.free_bytes()
    total = free_memory._fields(Path("/proc/meminfo"))["MemTotal"] * 1024
    assert free is not None
    assert 0 < free <= total


def test_ulimit_counts() -> None:
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (10**9, 10**9)); "
        "from cldit.io.free_memory import free_bytes; print(free_bytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 0 < int(done.stdout) < 10**9


def test_control_group_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_memory, "_GROUPS", tmp_path)
    own = Path("/proc/self/cgroup").read_text(encoding="utf-8")
    if not any(line.startswith("0::") for line in own.splitlines()):
        pytest.skip("control groups of version 1")
    (tmp_path / "memory.max").write_text("1000000\n")
    (tmp_path / "memory.current").write_text("700000\n")
    (tmp_path / "memory.stat").write_text("anon 600000\ninactive_file 50000\n")
    assert free_memory.free_bytes() == 350_000
    (tmp_path / "memory.max").write_text("max\n")
    free = free_memory.free_bytes()
    assert free is not None
    assert free > 350_000


def test_the_kernels_own_figure_is_in_kibibytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_memory, "_fields", lambda path: {"MemAvailable": 3})
    assert list(free_memory._machine()) == [3072]
