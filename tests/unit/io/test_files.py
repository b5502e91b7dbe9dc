"""Files and tables appear whole or not at all, by one writer a folder, and carry checksums."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest
import tifffile

from cldit.errors import DiskFull, EvaluationError, FileError, RunFolderError
from cldit.io import files
from cldit.io.data_streams import DataStream
from cldit.io.exclusive import exclusive, is_empty
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
from cldit.io.tables import Arrays, cached
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


def test_resolution_is_pixels_per_mm_across_and_up(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    write_image(path, np.zeros((2, 3), np.float32), name="a", unit="1", pixel_m=(5e-4, 2e-3))
    with tifffile.TiffFile(path) as file:
        tags = file.pages.first.tags
        across, up = (tags[name].value for name in ("XResolution", "YResolution"))
    assert across[0] / across[1] == pytest.approx(2.0)
    assert up[0] / up[1] == pytest.approx(0.5)


def test_an_error_without_a_text_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As memory that does not suffice."""

    def fails(*_: object, **__: object) -> None:
        raise MemoryError

    (tmp_path / "a.tif").write_bytes(b"II*\0")
    monkeypatch.setattr("cldit.io.images.tifffile.TiffFile", fails)
    with pytest.raises(RunFolderError, match=r"cannot be read as TIFF \(MemoryError\)"):
        read_image(tmp_path / "a.tif")


HOLD = """
import sys
from pathlib import Path
from cldit.io.exclusive import exclusive
with exclusive(Path(sys.argv[1]), "run"):
    print("held", flush=True)
    sys.stdin.read()
"""


def refused(folder: Path, *, nested: bool = False) -> bool:
    try:
        with exclusive(folder, "run", nested=nested):
            return False
    except RunFolderError as error:
        assert f"{folder}: another run is running here" in str(error)
        return True


def test_a_second_writer_is_refused_until_the_first_dies(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    assert refused(folder) and refused(folder, nested=True)
    assert is_empty(folder)  # but for the lock
    process.kill()
    process.communicate(timeout=HANG_s)
    with exclusive(folder, "run"):
        assert refused(folder) and not refused(folder, nested=True)
        seen: list[bool] = []
        thread = threading.Thread(target=lambda: seen.append(refused(folder, nested=True)))
        thread.start()
        thread.join()
        assert seen == [True]
    assert not refused(folder)
    with exclusive(tmp_path / "new", "run"):
        pass
    assert not (tmp_path / "new").exists()  # nothing was written


@pytest.mark.skipif(os.name == "nt", reason="POSIX tells whether a process lives")
def test_parts_of_killed_writers_are_removed(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    ours, theirs = files._HOST, f"{files._HOST}x"
    gone = tmp_path / f"a.tif.{ours}-{dead.pid}-1.part"
    kept = [
        tmp_path / f"a.tif.{ours}-{os.getpid()}-1.part",
        tmp_path / f"a.tif.{theirs}-{dead.pid}-1.part",  # of another machine
        tmp_path / "my.part",
    ]
    for path in (gone, *kept):
        path.write_bytes(b"x")
    files.write_text(tmp_path / "b.txt", "b")
    assert not gone.exists() and all(path.exists() for path in kept)


def test_a_flipped_bit_of_an_image_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "emission.tif"
    image = np.linspace(0.0, 1.0, 48, dtype=np.float32).reshape(6, 8)
    image[0, 0] = np.nan
    write_image(path, image, name="emission", unit="1")
    assert np.array_equal(read_image(path)[0], image, equal_nan=True)
    data = bytearray(path.read_bytes())
    place = data.index(image[3].astype("<f4").tobytes())
    data[place + 1] ^= 1
    path.write_bytes(data)
    with pytest.raises(RunFolderError, match=r"emission\.tif: .*not those that were recorded"):
        read_image(path)


@pytest.mark.parametrize("place", [0, 10, -9, -8, -1], ids=str)
def test_a_flipped_bit_is_noticed(place: int, tmp_path: Path) -> None:
    """In the head, and in the lowest bits of a value, which leave it finite."""
    made: list[Arrays] = []

    def make() -> Arrays:
        made.append({"a": np.linspace(0.0, 1.0, 5), "b": np.full((2, 2), 7.0)})
        return made[-1]

    for _ in range(2):
        found = cached(tmp_path, kind="k", description="t", make=make)
        np.testing.assert_array_equal(found["b"], np.full((2, 2), 7.0))
    assert len(made) == 1
    (path,) = tmp_path.iterdir()
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    found = cached(tmp_path, kind="k", description="t", make=make)
    assert len(made) == 2
    np.testing.assert_array_equal(found["a"], made[0]["a"])
    cached(tmp_path, kind="k", description="t", make=make)
    assert len(made) == 2
