"""Files to which an HDF5 file refers: missing ones are named, pipes are refused.

They are found as HDF5 finds them.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from cldit.acquisition.frames import open_stack
from cldit.acquisition.pictures.source import Source
from cldit.cfd.hdf.arrays import hdf_files, open_hdf
from cldit.errors import EvaluationError, FileError, SprayError
from cldit.io.hdf_files import check_links, check_sources

h5py = pytest.importorskip("h5py")


def write_part(path: Path, count: int = 3) -> None:
    path.parent.mkdir(exist_ok=True)
    with h5py.File(path, "w") as file:
        file["d"] = np.ones((count, 4), np.uint16)


def master(folder: Path, *parts: str) -> Path:
    """A virtual data set (3 rows of 4 a part) of other files."""
    layout = h5py.VirtualLayout((3 * len(parts), 4), np.uint16)
    for number, name in enumerate(parts):
        layout[3 * number : 3 * number + 3] = h5py.VirtualSource(name, "d", (3, 4))
    path = folder / "master.h5"
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("all", layout)
    return path


def check(path: Path) -> None:
    with h5py.File(path, "r") as file:
        check_links(path, file, complete=True)
        check_sources(path, file["all"])


@pytest.mark.parametrize("where", ["beside", "below", "absolute", "absolute, moved", "prefix"])
def test_sources_are_found_where_hdf5_finds_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """HDF5 itself reads ones, not zeros, exactly where no error is raised."""
    name = {"beside": "a.h5", "below": "part/a.h5", "prefix": "a.h5"}.get(where)
    asked = str(tmp_path / "gone" / "a.h5") if where == "absolute, moved" else name
    place = tmp_path / {"below": "part", "prefix": "far"}.get(where, "") / "a.h5"
    write_part(place)
    if where == "prefix":
        monkeypatch.setenv("HDF5_VDS_PREFIX", str(tmp_path / "far"))
    path = master(tmp_path, asked or str(place))
    check(path)
    with h5py.File(path, "r") as file:
        assert np.all(file["all"][()] == 1)
    place.unlink()
    with pytest.raises(FileError, match=r"master\.h5: /all: its source .*a\.h5 is missing"):
        check(path)


def test_one_missing_short_or_changed_source_is_named(tmp_path: Path) -> None:
    write_part(tmp_path / "a.h5")
    path = master(tmp_path, "a.h5", "b.h5")
    with pytest.raises(FileError, match=r"source .*b\.h5 is missing"):
        check(path)
    write_part(tmp_path / "b.h5", count=2)
    with pytest.raises(FileError, match=r"b\.h5 has the shape \(2, 4\), expected at least \(12,\)"):
        check(path)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["other"] = np.ones((3, 4))
    with pytest.raises(FileError, match=r"b\.h5 has no d, its source"):
        check(path)
    (tmp_path / "b.h5").write_bytes(b"no HDF5")
    with pytest.raises(FileError, match=r"b\.h5 cannot be read"):
        check(path)
    write_part(tmp_path / "b.h5")
    check(path)


def test_a_part_of_a_source_must_be_there(tmp_path: Path) -> None:
    """A data set takes rows 1 to 3 of a file that has two rows; its own rows are read, too."""
    layout = h5py.VirtualLayout((4, 4), np.uint16)
    layout[:2] = h5py.VirtualSource("a.h5", "d", (3, 4))[1:]
    layout[2:] = h5py.VirtualSource(".", "own", (2, 4))
    path = tmp_path / "master.h5"
    with h5py.File(path, "w") as file:
        file["own"] = np.ones((2, 4), np.uint16)
        file.create_virtual_dataset("all", layout)
    write_part(tmp_path / "a.h5")
    check(path)
    write_part(tmp_path / "a.h5", count=2)
    with pytest.raises(FileError, match=r"shape \(2, 4\), expected at least \(3, 4\)"):
        check(path)


def test_numbered_sources_without_an_end(tmp_path: Path) -> None:
    """As detectors write them: a file for each image, as many as there are."""
    for number in range(3):
        write_part(tmp_path / f"f-{number}.h5", count=1)
    path, h5s = tmp_path / "master.h5", h5py.h5s
    rows = h5s.create_simple((0, 4), (h5s.UNLIMITED, 4))
    rows.select_hyperslab((0, 0), (h5s.UNLIMITED, 1), (1, 1), (1, 4))
    made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    made.set_virtual(rows, b"f-%b.h5", b"d", h5s.create_simple((1, 4)))
    with h5py.File(path, "w") as file:
        h5py.h5d.create(file.id, b"all", h5py.h5t.NATIVE_UINT16, rows, made)
    check(path)
    (tmp_path / "f-0.h5").unlink()
    with pytest.raises(FileError, match=r"f-0\.h5 is missing"):
        check(path)


def test_readers_name_the_missing_file(tmp_path: Path) -> None:
    """Measured images and CFD files, which were read as zeros before."""
    path = master(tmp_path, "a.h5")
    with pytest.raises(EvaluationError, match=r"its source .*a\.h5 is missing"):
        open_stack(Source(path, "all"))
    with pytest.raises(SprayError, match=r"its source .*a\.h5 is missing"), open_hdf(path):
        pass


@pytest.mark.skipif(os.name == "nt", reason="no named pipes")
def test_a_link_to_a_pipe_is_refused(tmp_path: Path) -> None:
    """HDF5 would wait for ever for somebody who writes into it."""
    os.mkfifo(tmp_path / "pipe.h5")
    for number, name in enumerate(("pipe.h5", "gone.h5")):
        path = tmp_path / f"{number}.h5"
        with h5py.File(path, "w") as file:
            file["group/data"] = 1
            file["group/link"] = h5py.ExternalLink(name, "/d")
        text = (
            r"pipe\.h5: cannot be read \(is a pipe"
            if number == 0
            else r"is a link to .*gone\.h5, which is missing"
        )
        with pytest.raises(SprayError, match=text), open_hdf(path):
            pass
    with h5py.File(path, "r") as file:
        check_links(path, file, complete=False)
    with pytest.raises(FileError, match="is a pipe"):
        check(master(tmp_path, "pipe.h5"))


def test_all_files_of_a_case_are_named(tmp_path: Path) -> None:
    """Of a link, of the source of an array, and of that source's own source."""
    write_part(tmp_path / "a.h5")
    master(tmp_path, "a.h5").rename(tmp_path / "second.h5")
    layout = h5py.VirtualLayout((3, 4), np.uint16)
    layout[:] = h5py.VirtualSource("second.h5", "all", (3, 4))
    with h5py.File(tmp_path / "linked.h5", "w") as file:
        file["x"] = np.ones(3)
    with h5py.File(tmp_path / "case.h5", "w") as file:
        file.create_virtual_dataset("d", layout)
        file["there"] = h5py.ExternalLink("linked.h5", "x")
    names = ("case.h5", "a.h5", "linked.h5", "second.h5")
    assert hdf_files(tmp_path / "case.h5") == tuple(tmp_path / name for name in names)
