"""Files appear whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest

from cldit.errors import DiskFull, EvaluationError, FileError
from cldit.io.data_streams import DataStream
from cldit.io.files import (
    append_text,
    make_folder,
    read_text,
    text_encoding,
    whole,
    write_bytes,
    write_text,
    written,
)
from cldit.io.images import read_image, write_image
from cldit.io.tables import cached
from cldit.io.text_tables import read_table_text
from tests.full_disk import full_disk
from tests.patience import HANG_s


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
            both.wait(HANG_s)
            assert part.read_text(encoding="utf-8") == text

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write, ["one" * 1000, "two" * 1000]))
    assert path.read_text(encoding="utf-8") in ("one" * 1000, "two" * 1000)
    assert list(tmp_path.iterdir()) == [path]


def test_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    """Each way of writing: an error that says how much is needed, the old file, no part."""
    path = tmp_path / "file"
    write_text(path, "old\n")
    with full_disk(most_bytes=50_000):
        with pytest.raises(DiskFull, match=r"file: the disk is full.*free 3 MB.*resumes"):
            write_bytes(path, bytes(3_000_000))
        with pytest.raises(DiskFull, match="file: the disk is full"):
            append_text(path, "x" * 3_000_000)
        image = np.zeros((200, 200), np.float32)
        with pytest.raises(DiskFull, match=r"picture\.tif: the disk is full"):
            write_image(tmp_path / "picture.tif", image, name="", unit="")
        with pytest.raises(DiskFull), whole(path) as part, DataStream(part) as stream:
            np.savez(stream, a=np.zeros(100_000))
    assert path.read_text() == "old\n"
    assert list(tmp_path.iterdir()) == [path]
    append_text(path, "new\n")
    assert path.read_text() == "old\nnew\n"


def test_the_end_of_an_array_is_not_lost(tmp_path: Path) -> None:
    """The room ends within the last buffer: `ndarray.tofile` says nothing of it."""
    image = np.arange(24_576, dtype=np.uint16).reshape(128, 192)  # 48 kB, after a header
    with full_disk(most_bytes=image.nbytes + 100), pytest.raises(DiskFull):
        write_image(tmp_path / "a.tif", image, name="a", unit="counts")
    assert list(tmp_path.iterdir()) == []
    write_image(tmp_path / "a.tif", image, name="a", unit="counts")
    assert np.array_equal(read_image(tmp_path / "a.tif")[0], image)


def test_a_cache_that_cannot_be_kept_costs_only_the_time(tmp_path: Path) -> None:
    with full_disk(most_bytes=1000):
        arrays = cached(tmp_path, kind="k", description="t", make=lambda: {"a": np.ones(1000)})
    assert arrays["a"].sum() == 1000.0 and list(tmp_path.iterdir()) == []


def test_what_the_system_refuses_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match=r"file/a: cannot be written \(Not a directory\)"):
        make_folder(tmp_path / "file" / "a")
    with pytest.raises(FileError, match=r"none/a: cannot be written \(No such file"):
        write_text(tmp_path / "none" / "a", "")
    with pytest.raises(FileError, match="contains a NUL byte"):
        write_text(tmp_path / "a\0b", "")
    with pytest.raises(FileError, match="contains a NUL byte"):
        read_text(tmp_path / "a\0b")
    with pytest.raises(DiskFull), written(tmp_path):  # as HDF5 tells it
        raise OSError("file write failed: errno = 28, error message = 'No space left on device'")
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs a file with bad blocks")
@pytest.mark.parametrize("read", [read_text, text_encoding, read_table_text])
def test_a_read_that_fails_after_opening_names_the_file(
    read: Callable[[Path], object], tmp_path: Path
) -> None:
    """As of a broken disk or a network drive."""
    path = Path("/proc/self/mem")
    with pytest.raises(FileError, match=r"^/proc/self/mem: cannot be read \(Input/output error\)$"):
        read(path)


def test_long_values_are_cut_in_every_message() -> None:
    """Quotes, lists and words; not paths, and not text between two apostrophes."""
    long = "y" * 1000
    for text in (f"'{long}'", f'"{long}"', f"{[1] * 1000}", long, f"'{long[:80]}'"):
        assert len(str(EvaluationError(f"key: {text}; allowed: a, b"))) < 110
    prose = "the camera's offset, of all images that were read from this folder, and the spray's"
    path = "/".join(["folder"] * 50)
    assert str(FileError(f"{path}: {prose}")) == f"{path}: {prose}"
