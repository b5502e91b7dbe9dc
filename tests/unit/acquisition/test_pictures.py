"""Files of images as laboratories have them: read as meant, as far as they go, or refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from cldit.acquisition import frames
from cldit.acquisition.frames import FrameReader, open_stack
from cldit.acquisition.pictures.metadata import read_temperatures
from cldit.acquisition.pictures.source import Source, parse_source
from cldit.acquisition.pictures.tiff import turned
from cldit.errors import EvaluationError
from tests.measured_files import read_all

SHAPE = (6, 5, 7)
PICTURES = np.random.default_rng(1).integers(1000, 9000, SHAPE).astype(np.uint16)


@pytest.mark.parametrize("split", [(6,), (2, 3), (3, 2), (3, 1, 2)])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_imagej_stacks_of_any_axes_hold_every_picture(
    tmp_path: Path, split: tuple[int, ...], dtype: Any
) -> None:
    path = tmp_path / "stack.tif"
    pictures = PICTURES.astype(dtype)
    axes = {1: "TYX", 2: "TCYX", 3: "TZCYX"}[len(split)]
    tifffile.imwrite(
        path, pictures.reshape(*split, *SHAPE[1:]), imagej=True, metadata={"axes": axes}
    )
    np.testing.assert_array_equal(read_all(Source(path)), pictures)


TIFFS: dict[str, dict[str, Any]] = {
    "imagej": {"imagej": True},
    "shaped": {"metadata": {}},
    "plain": {"metadata": None},
    "pages": {"contiguous": False},
    "bigtiff": {"bigtiff": True},
    "compressed": {"compression": "zlib", "rowsperstrip": 8},
    "one page": {"metadata": {"truncate": True}},
    "ome": {"ome": True, "metadata": {"axes": "TYX"}},
}


@pytest.mark.parametrize("form", TIFFS)
@pytest.mark.parametrize("part", [0.3, 0.6, 0.98])
def test_tiffs_that_were_cut_off_are_named(
    tmp_path: Path, form: str, part: float, capfd: pytest.CaptureFixture[str]
) -> None:
    """Wherever it ends: as it is opened, or at the image that is not whole."""
    path = tmp_path / "cut.tif"
    stack = np.tile(PICTURES, (1, 20, 20))
    options = {"photometric": "minisblack", **TIFFS[form]}
    if form == "pages":
        with tifffile.TiffWriter(path) as file:
            for picture in stack:
                file.write(picture, **options)
    else:
        tifffile.imwrite(path, stack, **options)
    np.testing.assert_array_equal(read_all(Source(path)), stack)
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    with pytest.raises(EvaluationError, match=r"cut\.tif"):
        read_all(Source(path))
    assert "tifffile" not in capfd.readouterr().err


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_tags_are_followed_as_pillow_does(tmp_path: Path, orientation: int) -> None:
    from PIL import ImageOps

    path = tmp_path / "turned.tif"
    stored = PICTURES[0].astype(np.uint8)
    tifffile.imwrite(path, stored, extratags=[(274, "H", 1, orientation, True)])
    image = Image.fromarray(stored)
    image.getexif()[274] = orientation
    expected = np.asarray(ImageOps.exif_transpose(image))
    np.testing.assert_array_equal(turned(stored, orientation), expected)
    np.testing.assert_array_equal(read_all(Source(path))[0], expected)


def test_an_orientation_that_does_not_exist_is_named(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", PICTURES[0], extratags=[(274, "H", 1, 9, True)])
    with pytest.raises(EvaluationError, match="orientation tag 9; allowed: 1 to 8"):
        read_all(Source(tmp_path / "a.tif"))


@pytest.mark.parametrize("compression", ["zstd", "lzw", "zlib"])
def test_compressed_tiffs_are_read(tmp_path: Path, compression: str) -> None:
    pytest.importorskip("imagecodecs", reason="the extra files is not installed")
    path = tmp_path / "small.tif"
    tifffile.imwrite(path, PICTURES, compression=compression)
    np.testing.assert_array_equal(read_all(Source(path)), PICTURES)


def in_a_new_python(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs lines of code that find `open_stack`, `Source` and `Path`."""
    imports = (
        "import sys; from pathlib import Path\n"
        "from cldit.acquisition.frames import open_stack\n"
        "from cldit.acquisition.pictures.source import Source\n"
    )
    command = [sys.executable, "-c", imports + code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_compressed_tiff_names_the_extra_that_reads_it(tmp_path: Path) -> None:
    pytest.importorskip("imagecodecs", reason="the extra files is not installed")
    path = tmp_path / "small.tif"
    tifffile.imwrite(path, PICTURES, compression="zstd")
    code = "sys.modules['imagecodecs'] = None; open_stack(Source(Path(sys.argv[1]))).read(0)"
    said = in_a_new_python(code, path).stderr
    assert "pip install" in said and '"imagecodecs>=' in said and "small.tif" in said


def test_filters_of_hdf5_work_without_an_import_of_the_user(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="the extra files is not installed")
    plugin = pytest.importorskip("hdf5plugin", reason="the extra files is not installed")
    names = ("Blosc", "Bitshuffle", "Zstd")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in names:
            file.create_dataset(name, data=PICTURES, **getattr(plugin, name)())
    code = (
        "for name in sys.argv[2:]: "
        "print(open_stack(Source(Path(sys.argv[1]), f'/{name}')).read(0).sum())"
    )
    done = in_a_new_python(code, tmp_path / "a.h5", *names)
    assert done.stdout.split() == [str(PICTURES[0].sum())] * len(names), done.stderr


def _npy(path: Path) -> Path:
    np.save(path / "a.npy", PICTURES)
    return path / "a.npy"


def _png(path: Path) -> Path:
    Image.fromarray(PICTURES[0]).save(path / "a.png")
    return path / "a.png"


@pytest.mark.parametrize(("write", "expected"), [(_npy, PICTURES), (_png, PICTURES[:1])])
def test_plain_files(tmp_path: Path, write: Callable[[Path], Path], expected: Any) -> None:
    np.testing.assert_array_equal(read_all(Source(write(tmp_path))), expected)


@pytest.mark.parametrize("ending", ["seq", "csq", "ats", "ptw", "irb", "jpg"])
def test_other_films_have_a_way_out(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"x")
    with pytest.raises(EvaluationError, match=r"(export|save).*allowed: .*readers of your own"):
        open_stack(Source(path))


def _object(path: Path) -> Path:
    np.save(path / "a.npy", np.array([{}], object))
    return path / "a.npy"


def _colours(path: Path) -> Path:
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(path / "a.png")
    return path / "a.png"


def _ragged(path: Path) -> Path:
    (path / "a.csv").write_text("1,2\n3\n", encoding="utf-8")
    return path / "a.csv"


def _kelvin(path: Path) -> Path:
    from cldit.io.images import write_image

    write_image(path / "a.tif", PICTURES[0].astype(np.float32), name="T", unit="K")
    return path / "a.tif"


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (_object, "cannot be read"),
        (_colours, "colours, not counts"),
        (_ragged, "line 2: 1 numbers, expected 2"),
        (_kelvin, r"temperatures \(unit K\), not counts"),
    ],
)
def test_what_holds_no_counts_is_refused(
    tmp_path: Path, write: Callable[[Path], Path], message: str
) -> None:
    with pytest.raises(EvaluationError, match=message):
        open_stack(Source(write(tmp_path)))


@pytest.mark.parametrize(
    "axes",
    [("rows", "columns", "frames"), ("columns", "rows", "frames"), ("rows", "frames", "columns")],
)
def test_axes_in_any_order(tmp_path: Path, axes: Any) -> None:
    order = [("frames", "rows", "columns").index(one) for one in axes]
    stored = np.ascontiguousarray(PICTURES.transpose(order))
    np.save(tmp_path / "a.npy", stored)
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="minisblack")
    for name in ("a.npy", "a.tif"):
        found = read_all(Source(tmp_path / name, axes=axes))
        np.testing.assert_array_equal(found, PICTURES)


def test_a_reader_that_is_installed_later_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is installed is looked through once, and again for an ending that was not there."""
    monkeypatch.syspath_prepend(str(tmp_path))
    path = _npy(tmp_path)
    np.testing.assert_array_equal(read_all(Source(path)), PICTURES)
    asked: list[str] = []

    def watched(*, group: str, name: str) -> EntryPoints:
        asked.append(name)
        return entry_points(group=group, name=name)

    monkeypatch.setattr(frames, "entry_points", watched)
    np.testing.assert_array_equal(read_all(Source(path)), PICTURES)
    with pytest.raises(EvaluationError, match=r"\.later; allowed: "):
        open_stack(Source(tmp_path / "a.later"))
    assert asked == ["later"]  # .npy was looked up before
    info = tmp_path / "later-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: later\nVersion: 1.0\n")
    reader = "cldit.acquisition.pictures.plain:open_npy"
    (info / "entry_points.txt").write_text(f"[cldit.readers]\nlater = {reader}\n")
    later = path.rename(path.with_suffix(".later"))
    np.testing.assert_array_equal(read_all(Source(later)), PICTURES)
    np.testing.assert_array_equal(read_all(Source(later)), PICTURES)
    assert asked == ["later", "later"]


def test_an_installed_reader_comes_before_the_own_one_of_an_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Raw films are .dat as well; readers in the metadata of older versions of cldit are not."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "raw_film.py").write_text(
        "import numpy as np\n"
        "def read(source):\n    return np.fromfile(source.path, '<u2').reshape(-1, 5, 7)\n"
    )
    info = tmp_path / "raw_film-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: raw_film\nVersion: 1.0\n")
    points = "[cldit.readers]\ndat = raw_film:read\ncsv = cldit.gone:read\n"
    (info / "entry_points.txt").write_text(points)
    PICTURES.tofile(tmp_path / "a.dat")
    np.testing.assert_array_equal(read_all(Source(tmp_path / "a.dat")), PICTURES)
    np.savetxt(tmp_path / "a.csv", PICTURES[0], delimiter=",", fmt="%d")
    np.testing.assert_array_equal(read_all(Source(tmp_path / "a.csv")), PICTURES[:1])


def test_a_part_of_any_file(tmp_path: Path) -> None:
    _, source = parse_source(f"{_npy(tmp_path)}[1:4]")
    np.testing.assert_array_equal(read_all(source), PICTURES[1:4])
    with pytest.raises(EvaluationError, match="holds no image"):
        open_stack(parse_source(f"{_npy(tmp_path)}[4:4]")[1])


def test_temperatures_of_pictures(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time;T\n0;413,2\n1;413,4\n2;412,9\n", encoding="utf-8")

    def read(given: Any, count: int = 3) -> list[float]:
        return read_temperatures(tmp_path, given, where="here", count=count, setpoint_K=413.0)

    assert read("log.csv::T") == [413.2, 413.4, 412.9] and read([413.0], 1) == [413.0]
    assert read("log.csv::T[1:]", 2) == [413.4, 412.9]
    for given, message in (
        ("log.csv::T[1:]", "3 images and 2 temperatures"),
        ("log.csv::time", "temperature 0 is 0 "),
        ("log.csv::K", "no column K; it has time, T"),
        ([139.9, 140.0, 140.1], "degrees Celsius"),
        ([413.0, float("nan"), 413.0], "temperature 1 is nan"),
    ):
        with pytest.raises(EvaluationError, match=message):
            read(given)


FILM = np.random.default_rng(1).integers(0, 16000, (6, 20, 24)).astype(np.uint16)


def _pages(path: Path) -> None:
    with tifffile.TiffWriter(path) as file:
        for image in FILM:
            file.write(image, contiguous=False)


def _imagej(path: Path) -> None:
    tifffile.imwrite(path, FILM, imagej=True)


def _array(path: Path) -> None:
    np.save(path, FILM)


def _ome(path: Path) -> None:
    xml = tifffile.OmeXml()
    xml.addimage("uint16", (9, 20, 24), (9, 1, 1, 20, 24, 1), axes="TYX")  # three more elsewhere
    tifffile.imwrite(path, FILM, description=xml.tostring(), metadata=None)


@pytest.mark.parametrize(
    ("write", "name", "lost", "left"),
    [
        (_pages, "film.tif", 300, 5),
        (_imagej, "film.tif", 2000, 4),
        (_array, "film.npy", 1000, 4),
        (_ome, "film.ome.tif", 0, 6),
    ],
)
def test_what_is_there_is_read_on_request(
    write: object, name: str, lost: int, left: int, tmp_path: Path
) -> None:
    path = tmp_path / name
    assert callable(write)
    write(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - lost])
    reader = FrameReader()
    with pytest.raises(EvaluationError):
        stated = Source(path)
        [reader.read(stated, number) for number in range(len(FILM))]
    whole = Source(path, incomplete=True)
    assert len(reader.metadata(whole)) == left
    for number in range(left):
        np.testing.assert_array_equal(reader.read(whole, number), FILM[number])
    reader.close()
