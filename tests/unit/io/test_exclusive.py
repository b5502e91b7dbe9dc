"""One writer a folder; what killed writers left is removed; images carry their checksum."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from cldit.errors import RunFolderError
from cldit.io import files
from cldit.io.exclusive import exclusive, is_empty
from cldit.io.images import read_image, write_image
from tests.patience import HANG_s

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
