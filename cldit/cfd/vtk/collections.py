"""Files that name other files: .vtm, .pvtu and .pvd of ParaView, .series of foamToVTK."""

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from cldit.cfd.case import only_claimant
from cldit.cfd.inputs import regular
from cldit.cfd.vtk.composite import COMPOSITE
from cldit.errors import SprayError
from cldit.io.plain_data import read_json

DATA = (".vtu", ".vtp", ".vtk", ".vti", ".vtr", ".vts", *COMPOSITE)
PIECES = (".pvtu", ".pvtp", ".pvti", ".pvtr", ".pvts")
COLLECTIONS = (".vtm", *PIECES)
_STEP = re.compile(r"[_.-](\d+)$")


@dataclass(frozen=True)
class Entry:
    """One data set: its name, the files of its pieces, and whether its place marks a cloud.

    cloud: None if the content decides. named_by: files that name the pieces. time_s: one of several
    times in the file itself.
    """

    name: str
    pieces: tuple[Path, ...]
    cloud: bool | None = None
    named_by: tuple[Path, ...] = ()
    time_s: float | None = None


def stem(path: Path) -> str:
    """Name without the ending of its format: `case_20` of `case_20.vtm.series`."""
    name = path.name.removesuffix(".series")
    return Path(name).stem if Path(name).suffix in (*DATA, *COLLECTIONS, ".pvd") else name


def step_of(path: Path) -> str:
    """Step number in the name of a file, or of the nearest folder that has one; else ""."""
    names = [stem(path), *path.parts[-2::-1]]
    return next((match[1] for name in names if (match := _STEP.search(name))), "")


def without_step(name: str) -> str:
    """Name of a series: `rain` of `rain_20`."""
    return _STEP.sub("", name)


def entries(file: Path, seen: tuple[Path, ...] = ()) -> list[Entry]:
    """Data sets of a file or collection, in order; `seen`: the collections that contain it."""
    if file in seen:
        raise SprayError(f"{file}: names itself")
    named_by = (*seen, file)
    if file.suffix in DATA:
        _must_be(file, seen)
        return [Entry(stem(file), (file,), named_by=seen)]
    if file.suffix in PIECES:
        _must_be(file, seen)
        pieces = [file.parent / name for _, name in _named(file, "Piece", "Source")]
        for piece in pieces:
            _must_be(piece, named_by)
        return [Entry(stem(file), tuple(pieces), named_by=named_by)]
    if file.suffix == ".vtm":
        _must_be(file, seen)
        return [
            Entry(name or entry.name, entry.pieces, named_by=entry.named_by)
            for name, inside in _named(file, "DataSet", "file")
            for entry in entries(file.parent / inside, named_by)
        ]
    where = f"{seen[-1]}: names {file}, of a kind" if seen else f"{file}: is of a kind"
    allowed = f"{', '.join((*DATA, *COLLECTIONS))}; in ParaView, File > Save Data"
    raise SprayError(f"{where} that is not read; allowed: {allowed}")


def pvd_steps(file: Path) -> tuple[dict[float, list[Entry]], tuple[str, ...]]:
    """Data sets of each time that a .pvd file names, and a remark if its times go back."""
    by_time: dict[float, list[Entry]] = {}
    latest: dict[tuple[object, ...], float] = {}
    back: tuple[str, ...] = ()
    places: dict[tuple[object, ...], list[Path]] = {}
    for element in _elements(file, "DataSet"):
        stated = element.get("timestep", "0")
        try:
            time = float(stated)
        except ValueError as error:
            raise SprayError(f"{file}: states the time {stated!r}") from error
        inside = file.parent / element.get("file", "")
        place = (time, element.get("group", ""), element.get("part", "0"), inside.suffix)
        places.setdefault(place, []).append(inside)
        previous = latest.get(place[1:], time)
        latest[place[1:]] = time
        if time < previous:
            old = f"times after {time:g} that stand before it in the file may be of an older run"
            back = (f"{file}: its times go back from {previous:g} to {time:g}: {old}.",)
        by_time.setdefault(time, []).extend(entries(inside, (file,)))
    for (when, _, part, _), files in places.items():
        only_claimant(f"part {part} of time {when:g} in {file}", files)
    return by_time, back


def series(file: Path) -> list[tuple[str, float, Path]]:
    """Steps, times and files that a JSON file for ParaView lists."""
    data = read_json(file, error=SprayError)
    try:
        names = [(Path(entry["name"]), float(entry["time"])) for entry in data["files"]]
    except (ValueError, KeyError, TypeError) as error:
        raise SprayError(f"{file}: is no list of files and times ({error})") from error
    return [(step_of(name), time, file.parent / name) for name, time in names]


def _must_be(file: Path, named_by: tuple[Path, ...]) -> None:
    if not file.is_file():
        where = f"{named_by[-1]}: names {file}, which" if named_by else f"{file}:"
        raise SprayError(f"{where} is missing; keep a collection and its files together")


def _elements(file: Path, tag: str) -> list[ElementTree.Element]:
    try:
        root = ElementTree.parse(regular(file)).getroot()
    except SprayError:
        raise
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise SprayError(f"{file}: is damaged or truncated, no VTK collection ({error})") from error
    return list(root.iter(tag))


def _named(file: Path, tag: str, key: str) -> list[tuple[str, str]]:
    """Names and files of all elements `tag` that have a file; one without is an empty block."""
    files = [(item.get("name", ""), item.get(key, "")) for item in _elements(file, tag)]
    named = [(name, inside) for name, inside in files if inside]
    if not named:
        raise SprayError(f"{file}: names no file")
    return named
