"""Kinds of files of images: by their content, whatever their ending, and tables of programs."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from cldit.acquisition.frames import FrameReader, open_stack
from cldit.acquisition.pictures.metadata import read_numbers
from cldit.acquisition.pictures.source import Source, parse_source
from cldit.errors import EvaluationError
from tests.measured_files import read_all

IMAGES = np.random.default_rng(3).integers(1000, 9000, (6, 5, 7)).astype(np.uint16)
MATLAB_ORDER = IMAGES.transpose(1, 2, 0)


def notes(source: Source) -> str:
    reader = FrameReader()
    try:
        return "; ".join(reader.notes(source))
    finally:
        reader.close()


def _btf(path: Path) -> None:
    tifffile.imwrite(path, IMAGES, bigtiff=True, metadata=None)


def _netcdf4(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["counts"] = IMAGES
        file["time"] = np.arange(6.0)


def _packed(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["counts"] = (IMAGES - 1000).astype(np.int16)
        file["counts"].attrs.update(scale_factor=1.0, add_offset=1000.0)


def _netcdf3(path: Path) -> None:
    from scipy.io import netcdf_file

    with netcdf_file(path, "w") as file:
        for name, size in zip("nyx", IMAGES.shape, strict=True):
            file.createDimension(name, size)
        file.createVariable("counts", "i4", ("n", "y", "x"))[:] = IMAGES


def _matlab5(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"film": MATLAB_ORDER, "note": "shot"})


def _matlab7(path: Path) -> None:
    """HDF5 behind 512 bytes of MATLAB's; its arrays are stored with reversed axes."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        file["film"] = np.ascontiguousarray(MATLAB_ORDER.T)
        file["film"].attrs["MATLAB_class"] = np.bytes_("uint16")
        file["#refs#/a"] = IMAGES
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file")


def _zarr(path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(str(path), mode="w")
    for name, data, chunks in (("run/counts", IMAGES, (1, 5, 7)), ("log", np.arange(6.0), (6,))):
        array = group.create_array(name, shape=data.shape, dtype=data.dtype, chunks=chunks)
        array[...] = data


def _named_dimensions(path: Path) -> None:
    """As xarray writes an array with the dimensions y, x and time."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["counts"] = MATLAB_ORDER
        for number, (name, size) in enumerate(zip("yxt", MATLAB_ORDER.shape, strict=True)):
            file[name] = np.arange(size)
            file[name].make_scale(name)
            file["counts"].dims[number].attach_scale(file[name])


def _named_variables(path: Path) -> None:
    from scipy.io import netcdf_file

    with netcdf_file(path, "w") as file:
        for name, size in zip(("x", "frame", "y"), (7, 6, 5), strict=True):
            file.createDimension(name, size)
        data = file.createVariable("counts", "i4", ("x", "frame", "y"))
        data[:] = IMAGES.transpose(2, 0, 1)


WRITERS: list[tuple[str, Callable[[Path], None]]] = [
    ("a.btf", _btf), ("a.nc", _netcdf4), ("b.nc", _netcdf3),
    ("c.nc", _packed), ("d.nc", _named_dimensions), ("e.nc", _named_variables),
    ("a.mat", _matlab5), ("b.mat", _matlab7), ("a.zarr", _zarr),
]  # fmt: skip


@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_kinds_are_read_and_the_only_data_set_needs_no_name(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    path = tmp_path / name
    write(path)
    np.testing.assert_array_equal(read_all(Source(path)), IMAGES)
    part = parse_source(f"{path}[1::2]")[1]
    np.testing.assert_array_equal(read_all(part), IMAGES[1::2])
    if path.is_file():  # its content decides
        np.testing.assert_array_equal(read_all(Source(path.rename(tmp_path / "a.png"))), IMAGES)


def test_channels_in_turns_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, IMAGES.reshape(3, 2, 5, 7), imagej=True, metadata={"axes": "TCYX"})
    assert notes(Source(path)) == "2 channels in turns; [0::2] takes the first"
    np.testing.assert_array_equal(read_all(parse_source(f"{path}[1::2]")[1]), IMAGES[1::2])


@pytest.mark.parametrize("write", [_matlab5, _matlab7])
def test_the_order_of_matlabs_axes_is_reported_and_can_be_given(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    path = tmp_path / "a.mat"
    write(path)
    assert notes(Source(path)) == "axes: rows, columns, frames, as is usual in MATLAB"
    given = Source(path, axes=("columns", "rows", "frames"))
    np.testing.assert_array_equal(read_all(given), IMAGES.transpose(0, 2, 1))
    assert not notes(given)


@pytest.mark.parametrize(
    ("ending", "package", "name"),
    [("zarr", "zarr", "zarr"), ("h5", "h5py", "h5py")],
)  # fmt: skip
def test_a_missing_package_is_named_with_the_line_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, package: str, name: str
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / f"a.{ending}").write_bytes(b"x")
    with pytest.raises(EvaluationError, match=rf'needs {package}; .*pip install "{name}>='):
        open_stack(Source(tmp_path / f"a.{ending}"))


@pytest.mark.parametrize(("name", "write"), [("a.zarr", _zarr), ("a.nc", _netcdf4)])
def test_data_sets_that_are_not_there_are_answered_with_those_that_are(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    write(tmp_path / name)
    known = "/run/counts" if name == "a.zarr" else "/counts"
    with pytest.raises(EvaluationError, match=f"no such data set; the file has {known}$"):
        open_stack(Source(tmp_path / name, "/other"))
    line = "/log" if name == "a.zarr" else "/time"
    assert read_numbers(tmp_path, f"{name}::{line}[::2]", column="") == [0.0, 2.0, 4.0]
    with pytest.raises(EvaluationError, match="shape"):
        open_stack(Source(tmp_path / name, line))


@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_files_that_lost_a_part_are_refused(
    tmp_path: Path, name: str, write: Callable[[Path], None], capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    write(path)
    if path.is_dir():  # a chunk would be read as zeros
        next(each for each in path.rglob("c/3/*/*") if each.is_file()).unlink()
    else:
        path.write_bytes(path.read_bytes()[: int(0.9 * path.stat().st_size)])
    with pytest.raises(EvaluationError, match=name):
        read_all(Source(path))
    assert not capfd.readouterr().err


@pytest.mark.parametrize("virtual", [False, True])
def test_chunks_of_hdf5_that_were_never_written_are_refused(tmp_path: Path, virtual: bool) -> None:
    """HDF5 reads them as zeros; `incomplete` reads what is there."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("film", IMAGES.shape, IMAGES.dtype, chunks=(1, 3, 7))
        data[:2], data[2, :3], data[3:] = IMAGES[:2], IMAGES[2, :3], IMAGES[3:]
    path = tmp_path / "a.h5"
    if virtual:
        layout = h5py.VirtualLayout(IMAGES.shape, IMAGES.dtype)
        layout[:] = h5py.VirtualSource(path, "film", IMAGES.shape)
        path = tmp_path / "b.h5"
        with h5py.File(path, "w") as file:
            file.create_virtual_dataset("film", layout)
    with pytest.raises(EvaluationError, match=r"a\.h5: /film: 1 of 12 chunks are missing"):
        open_stack(Source(path))
    assert len(read_all(Source(path, incomplete=True))) == len(IMAGES)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="needs a file with bad blocks")
@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_a_read_that_fails_after_opening_names_the_file(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    """Reads of /proc/self/mem near 0 fail as those of a broken disk: it takes the file's place."""
    path = tmp_path / name
    write(path)
    reader = FrameReader()
    reader.notes(Source(path))
    with Path("/proc/self/mem").open("rb") as broken:
        for number in (int(entry.name) for entry in Path("/proc/self/fd").iterdir()):
            with suppress(OSError):
                if Path(f"/proc/self/fd/{number}").readlink() == path:
                    os.dup2(broken.fileno(), number)
    try:
        images = [reader.read(Source(path), number) for number in range(len(IMAGES))]
    except EvaluationError as error:
        assert str(path) in str(error)
    else:  # they are in memory
        np.testing.assert_array_equal(images, IMAGES)
    reader.close()


def _lines(between: str, point: str, form: str = "{:.2f}") -> list[str]:
    return [between.join(form.format(v / 4).replace(".", point) for v in row) for row in IMAGES[0]]


IRBIS = "[Settings]\nVersion=4\nImageWidth=7\nImageHeight=5\nShotRange=20,00;40,00\n{}\n[Data]\n"
FLIR = "File:,C:\\a.csq\n\nParameters:,Emissivity: 0.95\n,Refl. temp: 20.00 °C\n\n"


def _flir() -> str:
    """`Frame N` in front of the first row of each image, nothing in front of the others."""
    text = FLIR
    for number, image in enumerate(IMAGES, start=1):
        for row, line in enumerate(image / 4):
            label = f"Frame {number}" if row == 0 else ""
            text += ",".join([label, *(f"{value:.2f}" for value in line)]) + "\n"
        text += "\n"
    return text


def _numbered() -> str:
    """As pandas writes: numbers of columns and rows around the image."""
    rows = [",".join([f"{n}", line]) for n, line in enumerate(_lines(",", "."))]
    return "\n".join([",0,1,2,3,4,5,6", *rows])


TABLES: list[tuple[str, str, str, Any, str]] = [
    ("irbis.asc", IRBIS.format("TempUnit=counts") + "\n".join(_lines("\t", ",")), "utf-16",
     IMAGES[:1], "header rows omitted: 7; unit counts"),
    ("irbis.csv", IRBIS.format("") + "\n".join(_lines(",", ".")) , "utf-8", IMAGES[:1],
     "header rows omitted: 6"),
    ("optris.csv", "\n".join(line + ";" for line in _lines(";", ",")), "cp1252", IMAGES[:1], ""),
    ("quoted.csv", "\n".join('"' + '","'.join(line.split(";")) + '"' for line in _lines(";", ",")),
     "utf-8", IMAGES[:1], ""),
    ("blanks.dat", "\n".join(_lines("  ", ",")), "utf-8-sig", IMAGES[:1], ""),
    ("flir.csv", _flir(), "cp1252", IMAGES, "header rows omitted: 3"),
    ("pandas.csv", _numbered(), "utf-8", IMAGES[:1],
     "header rows omitted: 1; first column omitted: it has the rows' positions"),
    ("columns.csv", "\n".join(["0.0,0.1,0.2,0.3,0.4,0.5,0.6", *_lines(",", ".")]), "utf-8",
     IMAGES[:1], "first row omitted: it has the columns' positions"),
    ("mm.txt", "\n".join(["-0.10 -0.07 -0.03 0.00 0.03 0.07 0.10", *_lines(" ", ".")]), "utf-8",
     IMAGES[:1], "first row omitted: it has the columns' positions"),
    ("size.txt", "7 5\n" + "\n".join(_lines(" ", ".")), "ascii", IMAGES[:1],
     "header rows omitted: 1"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text", "encoding", "expected", "said"), TABLES, ids=[row[0] for row in TABLES]
)
def test_tables_as_programs_of_cameras_export_them(
    tmp_path: Path, name: str, text: str, encoding: str, expected: Any, said: str
) -> None:
    (tmp_path / name).write_text(text, encoding=encoding)
    np.testing.assert_array_equal(read_all(Source(tmp_path / name)), expected / 4)
    unit = "" if "unit" in said else "no unit, read as counts"
    assert notes(Source(tmp_path / name)) == "; ".join(part for part in (said, unit) if part)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (IRBIS.format("TempUnit=°C") + "\n".join(_lines("\t", ",")), r"temperatures \(unit °C\)"),
        (IRBIS.format("") + "\n".join(_lines("\t", ",")[:4]), "Height 5, its numbers 4; cut off"),
        (_flir()[:-40], "line 40: 2 numbers, expected 7"),
        ("".join(_flir().splitlines(True)[:-2]), "its frames have 4, 5 rows; cut off"),
        ("x;y\n1;2\n3;oops\n", "line 3: '3;oops'; allowed: numbers only"),
        ("nothing\n", "no line of numbers"),
    ],
)
def test_tables_that_are_no_counts_or_cut_off_are_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(EvaluationError, match=message):
        open_stack(Source(tmp_path / "a.csv"))


def test_whole_numbers_of_a_table_are_integers(tmp_path: Path) -> None:
    """Rounding to counts is a noise of integers alone."""
    np.savetxt(tmp_path / "a.csv", IMAGES[0], delimiter=";", fmt="%d")
    assert read_all(Source(tmp_path / "a.csv")).dtype == np.uint16
    np.savetxt(tmp_path / "a.csv", IMAGES[0] / 4, delimiter=";")
    assert read_all(Source(tmp_path / "a.csv")).dtype == np.float64


def test_decimals_that_could_be_degrees_are_reported(tmp_path: Path) -> None:
    """Optris' programs export degrees Celsius without a word of it."""
    lines = [";".join(f"{20 + value / 1e3:.1f}" for value in row) for row in IMAGES[0]]
    (tmp_path / "a.csv").write_text("\n".join(lines).replace(".", ","))
    assert re.search("no unit, .*decimals of 2.* to 2.* could be degrees Celsius",
                     notes(Source(tmp_path / "a.csv")))  # fmt: skip


def test_a_ramp_is_an_image_and_no_header(tmp_path: Path) -> None:
    """Evenly spaced numbers in all rows are pixels."""
    ramp = np.arange(48.0).reshape(6, 8)
    np.savetxt(tmp_path / "a.txt", ramp)
    np.testing.assert_array_equal(read_all(Source(tmp_path / "a.txt"))[0], ramp)


def test_logs_with_header_rows_and_units(tmp_path: Path) -> None:
    text = "Logger 7\nSerial;123\n\nTime;T bb\n[s];[°C]\n0;140,5\n1;140,7\n2;140,6\n"
    (tmp_path / "log.csv").write_text(text, encoding="utf-16")
    assert read_numbers(tmp_path, "log.csv::T bb", column="") == [140.5, 140.7, 140.6]
    assert read_numbers(tmp_path, "log.csv::T bb[0:3:2]", column="") == [140.5, 140.6]
    (tmp_path / "log.csv").write_text(text.replace("140,7", "-"), encoding="utf-8")
    with pytest.raises(EvaluationError, match="line 7: T bb is '-'"):
        read_numbers(tmp_path, "log.csv::T bb", column="")


def test_frames_of_a_map_are_not_read_before_they_are_asked_for(tmp_path: Path) -> None:
    """Every tenth image of a file of 200 MB, of which little is read: far less memory than it."""
    import tracemalloc

    data = np.lib.format.open_memmap(
        tmp_path / "a.npy", mode="w+", dtype=np.uint16, shape=(400, 512, 512)
    )
    data[10, 0, 0] = 7
    del data
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stack = open_stack(parse_source(f"{tmp_path / 'a.npy'}[0::10]")[1])
        assert len(stack) == 40 and stack.read(1)[0, 0] == 7
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()
