"""Files appear whole or not at all."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from cldit.files import whole, write_text


def test_what_was_there_stays_until_the_end(tmp_path: Path) -> None:
    path = tmp_path / "with space.txt"
    write_text(path, "old\n")
    with whole(path) as part:
        part.write_text("new µ\n", encoding="utf-8")
        assert path.read_text(encoding="utf-8") == "old\n"
    assert path.read_text(encoding="utf-8") == "new µ\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("sync", [True, False])
def test_a_failure_changes_nothing(tmp_path: Path, sync: bool) -> None:
    path = tmp_path / "file"
    write_text(path, "old\n")
    with pytest.raises(RuntimeError, match="half"), whole(path, sync=sync) as part:
        part.write_text("torn", encoding="utf-8")
        raise RuntimeError("half way")
    assert path.read_text(encoding="utf-8") == "old\n"
    assert list(tmp_path.iterdir()) == [path]


def test_two_that_write_the_same_file_do_not_meet(tmp_path: Path) -> None:
    """Each has a part of its own: threads by their number, processes by theirs."""
    path, both = tmp_path / "file", Barrier(2)

    def write(text: str) -> None:
        with whole(path) as part:
            part.write_text(text, encoding="utf-8")
            both.wait(10)
            assert part.read_text(encoding="utf-8") == text

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write, ["one" * 1000, "two" * 1000]))
    assert path.read_text(encoding="utf-8") in ("one" * 1000, "two" * 1000)
    assert list(tmp_path.iterdir()) == [path]
