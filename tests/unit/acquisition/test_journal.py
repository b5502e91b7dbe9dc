"""The journal: survives what a kill or a full disk does to it, and notices everything else."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from cldit.acquisition.journal import Journal
from cldit.errors import DiskFull, RunFolderError
from tests.journals import read_journal

TIME = "2000-01-01T00:00:00+00:00"


def three(path: Path) -> bytes:
    with Journal(path) as journal:
        for number in range(3):
            journal.append("saved", time=TIME, shot=f"b00_ref_{number:02d}")
    return path.read_bytes()


def test_round_trip(tmp_path: Path) -> None:
    three(tmp_path / "j")
    assert [entry["seq"] for entry in read_journal(tmp_path / "j")] == [0, 1, 2]
    assert read_journal(tmp_path / "none") == []


def test_torn_anywhere(tmp_path: Path) -> None:
    """After a cut at any length whole lines count, and the next line starts afresh."""
    path = tmp_path / "j"
    whole = three(path)
    ends = [place for place, byte in enumerate(whole) if byte == ord("\n")]
    near = {end + step for end in ends for step in (-1, 0, 1)}
    for cut in sorted({*range(0, len(whole), 11), *near}):
        path.write_bytes(whole[:cut])
        kept = whole[:cut].count(b"\n")
        assert len(read_journal(path)) == kept
        with Journal(path) as journal:
            journal.append("fired", time=TIME)
        assert [entry["seq"] for entry in read_journal(path)] == list(range(kept + 1))
        assert path.read_bytes().endswith(b"}\n")  # nothing of the torn line stays


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"{torn", "line 2 is not JSON"),
        (b"[]", "line 2 does not carry the sequence number 1"),
        (b'{"seq": 7, "event": "saved", "time": "' + TIME.encode() + b'"}', "sequence number 1"),
        (b'{"seq": 1, "event": "saved", "time": "noon"}', "no time or no event"),
    ],
)
def test_damage_elsewhere_is_an_error(tmp_path: Path, line: bytes, message: str) -> None:
    path = tmp_path / "j"
    first, _, third = three(path).splitlines()
    path.write_bytes(b"\n".join([first, line, third, b""]))
    with pytest.raises(RunFolderError, match=message):
        read_journal(path)
    with pytest.raises(RunFolderError, match=message):
        Journal(path)


def test_full_disk_leaves_it_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a line fits; the journal keeps its whole lines and takes the next one later."""
    path = tmp_path / "j"
    before = three(path)
    real = os.write

    def half(handle: int, data: bytes) -> int:
        if len(data) < 20:
            raise OSError(28, "No space left on device")
        return real(handle, data[:-10])

    with Journal(path, lambda: 5_000_000) as journal:
        with monkeypatch.context() as patch:
            patch.setattr(os, "write", half)
            with pytest.raises(DiskFull, match="free 5 MB"):
                journal.append("fired", time=TIME)
        assert path.read_bytes() == before
        journal.append("fired", time=TIME)
    assert len(read_journal(path)) == 4


def test_nothing_that_json_cannot_hold(tmp_path: Path) -> None:
    with Journal(tmp_path / "j") as journal, pytest.raises(ValueError):
        journal.append("saved", time=TIME, reading_K=float("nan"))
    assert json.dumps(read_journal(tmp_path / "j")) == "[]"
