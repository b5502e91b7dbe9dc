"""Homes that cannot be written, as users of containers have them, and memory that is free."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cldit.errors import FileError
from cldit.io import free_memory
from cldit.io.caches import default_cache

CODE = (
    "import os; from cldit.io.caches import default_cache; "
    "from cldit.gpu.device import open_device; "
    "device = open_device(); device.queue; "
    "print(default_cache(), os.environ.get('POCL_CACHE_DIR'), os.environ.get('XDG_CACHE_HOME'))"
)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder nobody can write")
@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"HOME": "/proc/x"}, "/proc/x/.cache/cldit: caches cannot be kept here"),
        ({"HOME": "/proc/x", "POCL_CACHE_DIR": "PLACE"}, "/proc/x/.cache/cldit: caches"),
        ({"HOME": "/proc/x", "XDG_CACHE_HOME": "PLACE"}, ""),
        ({"XDG_CACHE_HOME": "/proc/x"}, "/proc/x/cldit: caches cannot be kept here"),
        ({"POCL_CACHE_DIR": "/proc/x"}, "POCL_CACHE_DIR: /proc/x cannot be written"),
    ],
    ids=lambda part: "-".join(part) if isinstance(part, dict) else "line",
)
def test_devices_are_found(changed: dict[str, str], line: str, tmp_path: Path) -> None:
    """Caches go into a temporary folder and one line says so; folders that serve are kept."""
    place = tmp_path / "place"
    place.mkdir()
    changed = {name: value.replace("PLACE", str(place)) for name, value in changed.items()}
    environment = {k: v for k, v in os.environ.items() if k not in ("XDG_CACHE_HOME", "HOME")}
    environment |= {"HOME": str(tmp_path), "TMPDIR": str(tmp_path), **changed}
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("\n") == (1 if line else 0) and line in done.stderr, done.stderr
    assert str(tmp_path) in done.stdout and "/proc/x" not in done.stdout
    if changed.get("POCL_CACHE_DIR") == str(place):
        assert f" {place} " in done.stdout


def test_a_cache_of_ones_own_is_not_shared_with_who_made_the_name_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In /tmp anybody can make the folder beforehand; one that others may write is not used."""
    from cldit.io import caches

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first = caches._temporary(Path("/home"))
    assert first.parent == tmp_path and caches._temporary(Path("/home")) == first
    first.chmod(0o777)
    assert caches._temporary(Path("/home")) != first
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(FileError, match=r"/home: caches cannot be kept here.*XDG_CACHE_HOME"):
        caches._temporary(Path("/home"))


def test_a_folder_that_is_named_goes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache() == tmp_path / "cldit"


def test_a_full_folder_of_compiled_kernels_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """PoCL would abort the process there; other caches have room enough and stay."""
    from cldit.io import caches

    home, temporary = tmp_path / "home", tmp_path / "temporary"
    temporary.mkdir()

    def full(folder: Path, size: int) -> None:
        if folder.is_relative_to(home) and size > 1_000_000:
            raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("POCL_CACHE_DIR", "MPLCONFIGDIR"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.setattr(caches, "probe", full)
    caches.use_caches.__wrapped__()
    assert caches.pocl_cache().is_relative_to(temporary)
    assert default_cache() == home / "cldit"
    assert f"POCL_CACHE_DIR: {home / 'pocl'} cannot be written or is full" in caplog.text


on_linux = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="nobody says what is free elsewhere"
)


@on_linux
def test_no_more_than_there_is() -> None:
    free = free_memory.free_bytes()
    total = free_memory._fields(Path("/proc/meminfo"))["MemTotal"] * 1024
    assert free is not None
    assert 0 < free <= total


@on_linux
def test_ulimit_counts() -> None:
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (10**9, 10**9)); "
        "from cldit.io.free_memory import free_bytes; print(free_bytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 0 < int(done.stdout) < 10**9


@on_linux
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


@on_linux
def test_the_kernels_own_figure_is_in_kibibytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_memory, "_fields", lambda path: {"MemAvailable": 3})
    assert list(free_memory._machine()) == [3072]
