"""Archives that a spray cannot be read from: a name twice, more content than memory."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from cldit.errors import SprayError
from cldit.spray.spray_file import read_spray


def test_a_name_twice_and_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "spray.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("about.npy", b" " * 1_000_000)
    monkeypatch.setattr("cldit.spray.spray_file.free_bytes", lambda: 500_000)
    with pytest.raises(SprayError, match=r"unpacks to 0\.001 GB; 0\.0005 GB of memory are free"):
        read_spray(path)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("about.npy", b"")
    with pytest.raises(SprayError, match=r"has about\.npy twice"):
        read_spray(path)
