"""Draft of measured.yaml from a folder of images, `cldit evaluate --write-measured`."""

import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import multimode

import numpy as np

from cldit.acquisition.frames import FrameReader, own_reader
from cldit.acquisition.pictures.kinds import kind_of
from cldit.acquisition.pictures.names import Reported, reported, without_role, words_of
from cldit.acquisition.pictures.source import NoDataSet, Source
from cldit.errors import EvaluationError
from cldit.io.files import natural_order, write_text
from cldit.io.plain_data import yaml_value
from cldit.io.text_tables import read_table_text, split_cells
from cldit.scene.values import ZERO_CELSIUS_K

_BITS = (8, 10, 12, 14, 16)
_MOST_MISSING = 8  # frame numbers that are listed
_SMALLEST = 8  # rows and columns of an image; smaller tables are logs
Files = Callable[[Sequence["Recording"]], str]


@dataclass(frozen=True)
class Recording:
    """A file, or a data set in it: number and form of its images, and what its name reports.

    form: (rows, columns) and type. low, high: of its first and last image. middle: their median.
    """

    source: Source
    name: str
    count: int
    form: tuple[tuple[int, ...], str]
    low: float
    high: float
    middle: float
    reported: Reported


def write_measured(folder: Path, out: Path) -> list[str]:
    """Writes a first measured.yaml for the images in a folder, by their names and content.

    What cannot be found is in comments. Returns lines for the user: the file and what is missing.
    Raises EvaluationError if the file exists, or the folder has no image.
    """
    if out.exists():
        raise EvaluationError(f"{out}: exists already (--write-measured); give another name")
    if not folder.is_dir():
        raise EvaluationError(f"{folder}: is no folder (--write-measured drafts from its images)")
    found, others = _recordings(folder)
    if not found:
        seen = f"; {others[0]}" if others else ""
        raise EvaluationError(f"{folder}: no image was found (--write-measured){seen}")
    lines = [*_lines(folder.resolve(), out.resolve().parent, found, others)]
    write_text(out, "\n".join(lines) + "\n")
    missing = [line.strip(" #-") for line in lines if "# not found" in line]
    names = dict.fromkeys(line.partition("  # not")[0].partition(":")[0] for line in missing)
    return [str(out), *(f"  not found: {name}" for name in names)]


def _recordings(folder: Path) -> tuple[list[Recording], list[str]]:
    """Images of the most frequent form, and lines on all other files that might matter."""
    reader = FrameReader()
    found: list[Recording] = []
    others: list[str] = []
    for path in sorted(_files(folder), key=natural_order):
        name = path.relative_to(folder).as_posix()
        kind = kind_of(path)
        own = own_reader(path) is not None
        if kind is None and not own:
            continue
        if kind is not None and not kind.reader and not own:
            others.append(f"{name} is {kind.name}: {kind.way_out}")
            continue
        try:
            found += _opened(reader, path, name)
        except EvaluationError as error:
            columns = _columns(path) if kind is not None and kind.name == "text" else ()
            others.append(f"table {name}: {', '.join(columns)}" if columns else str(error))
    reader.close()
    logs = [each for each in found if min(each.form[0]) < _SMALLEST]
    images = [each for each in found if each not in logs]
    sizes = multimode([each.form[0] for each in images for _ in range(each.count)])
    size = sizes[0] if sizes else ()
    others += [f"table {each.name}: {', '.join(_columns(each.source.path))}" for each in logs]
    others += [f"{each.name}: {_form(each)}, another size" for each in images
               if each.form[0] != size]  # fmt: skip
    return _distinguished([each for each in images if each.form[0] == size]), others


def _distinguished(found: list[Recording]) -> list[Recording]:
    """Images with their kinds by the words that not all names have, if all have the same kind."""
    images = [each for each in found if each.reported.role not in ("dark", "defective")]
    if len({each.reported.role for each in images}) != 1:
        return found
    shared = set.intersection(*(set(words_of(each.name)) for each in images))
    again = {each.name: reported(each.name, shared) for each in images}
    if len({one.role for one in again.values()}) < 2:
        return found
    return [replace(each, reported=again.get(each.name, each.reported)) for each in found]


def _files(folder: Path) -> Iterator[Path]:
    """Files and Zarr folders, without hidden ones, and maps of an evaluation with their figure."""
    for root, folders, files in os.walk(folder):
        here = Path(root)
        zarrs = [name for name in folders if kind_of(here / name) is not None]
        yield from (here / name for name in zarrs)
        folders[:] = sorted(
            name for name in folders if not (name[0] == "." or name in ("maps", *zarrs))
        )
        yield from (here / name for name in files if name[0] != "." and Path(name).stem != "maps")


def _opened(reader: FrameReader, path: Path, name: str) -> list[Recording]:
    try:
        return [_recording(reader, Source(path), name)]
    except NoDataSet as error:
        sets = [Source(path, dataset) for dataset in error.known]
        return [_recording(reader, each, f"{name}::{each.dataset}") for each in sets]


def _recording(reader: FrameReader, source: Source, name: str) -> Recording:
    count = len(reader.told(source))
    ends = np.stack([reader.read(source, number) for number in {0, count - 1}])
    return Recording(
        source,
        name,
        count,
        (ends.shape[1:], str(ends.dtype)),
        float(ends.min()),
        float(ends.max()),
        float(np.median(ends)),
        reported(name),
    )


def _columns(path: Path) -> Sequence[str]:
    """Names of the columns of a log: the first line with several cells, none of them a number."""
    try:
        lines = read_table_text(path).splitlines()
    except OSError:
        return ()
    cells = [split_cells(line)[0] for line in lines[:100]]
    return next(
        (row for row in cells if len(row) > 1 and not any(re.match(r"[-+\d.]", c) for c in row)), ()
    )


def _form(one: Recording) -> str:
    (rows, columns), kind = one.form
    return f"{columns} x {rows} {kind}"


def _lines(folder: Path, base: Path, found: list[Recording], others: list[str]) -> Iterator[str]:
    """Lines of the draft; names are relative to `base`, the folder of the file."""
    inside = Path(os.path.relpath(folder, base)).as_posix()
    prefix = "" if inside == "." else f"{inside}/"
    names = [prefix + each.name for each in found]

    def files(some: Sequence[Recording]) -> str:
        return yaml_value(_patterns([prefix + each.name for each in some], names))

    def role(name: str) -> list[Recording]:
        return [each for each in found if each.reported.role == name]

    images = [each for each in found if each.reported.role not in ("dark", "defective")]
    total, columns = sum(each.count for each in images), found[0].form[0][1]
    yield f"# Drafted from the names of {total} images. Complete and uncomment what was not found."
    yield f"name: {yaml_value(folder.name or 'measured')}"
    yield "# filter_um: [3.3, 3.5]  # not found: edges of the filter, or a file with its curve"
    yield "setup:"
    yield "  # pixel_m: [1.0e-4, 1.0e-4]  # not found: width and height of a pixel at the spray"
    yield f"  # injector_pixel: [{columns // 2}, 0]  # of its tip; default: the centre"
    yield "  # wall_temperature_K: 300.0  # default; of the chamber"
    yield "  # background_emissivity: 1.0  # default; of the black body"
    yield "  # windows: []  # default; see docs/dit.md"
    yield "sensor:"
    yield from _sensor(images or found, role("dark"))
    for each in role("defective"):
        if each.middle == 0.0:
            yield f"bad_pixels: {files([each])}"
        else:
            yield f"# bad_pixels: {files([each])}  # not found: most of its pixels are not 0"
    yield "backgrounds:"
    yield from _backgrounds(images, files)
    yield from (f"# {' '.join(line.split())}" for line in others)


def _sensor(images: Sequence[Recording], dark: Sequence[Recording]) -> Iterator[str]:
    high = max(each.high for each in images)
    bits = next((bits for bits in _BITS if high < 2**bits), None)
    whole = all(each.form[1].startswith(("uint", "int")) for each in images)
    if whole and bits is not None:
        yield (
            f"  saturation_counts: {2**bits - 1}  # {bits} bits: the largest count read is "
            f"{high:g}; check"
        )
    else:
        yield f"  # saturation_counts: {1.1 * high:.4g}  # not found: the largest is {high:g}"
    if dark:
        offset = float(np.median([each.middle for each in dark]))
        yield f"  offset_counts: {offset:g}  # median of {dark[0].name}, {len(dark)} files"


def _backgrounds(images: Sequence[Recording], files: Files) -> Iterator[str]:
    groups: dict[tuple[float, str, str], list[Recording]] = {}
    for each in images:
        value, unit = 0.0, ""
        if each.reported.temperature is not None:
            value, unit = each.reported.temperature
        same = each.name if each.count > 1 else each.name.rpartition("/")[0]
        place = "" if value else without_role(same)
        groups.setdefault((value, unit, place), []).append(each)
    for (value, unit, place), here in sorted(groups.items(), key=_warmth):
        if unit:
            yield f"  - temperature_{unit}: {value:g}"
        elif value:
            yield f"  - # temperature_K: {value:g}  # not found: its unit; K, or temperature_C"
        else:
            where = place or "these images; names as 423K and T150C show it"
            yield f"  - # temperature_K: 400.0  # not found: of {where}"
        roles = {role: [each for each in here if each.reported.role == role]
                 for role in ("reference", "injection", "")}  # fmt: skip
        notes: dict[str, str] = {}
        for one, other in (("reference", "injection"), ("injection", "reference")):
            if roles[one] and not roles[other] and roles[""]:
                roles[other], notes[other] = roles.pop(""), "; the names do not say so, check"
        rest = roles.get("", [])
        if rest and not (roles["reference"] or roles["injection"]):
            yield from _either(rest, files)
            continue
        yield from _kind("references", roles["reference"], files, notes.get("reference", ""))
        delays = sorted({each.reported.delay_s or 0.0 for each in roles["injection"]})
        for number, delay_s in enumerate(delays or [0.0]):
            some = [
                each for each in roles["injection"] if (each.reported.delay_s or 0.0) == delay_s
            ]
            several = f"; delay {1e3 * delay_s:g} ms" if len(delays) > 1 else ""
            several += ", for a file of its own" if number else ""
            for line in _kind("injections", some, files, notes.get("injection", "") + several):
                yield line.replace("    inj", "    # inj") if number else line
        if rest:
            yield f"    # {files(rest)}  # not found: whether these have spray"


def _either(some: Sequence[Recording], files: Files) -> Iterator[str]:
    """Lines for images of either kind: two parts of a film, or the same names twice."""
    names, count = files(some), sum(each.count for each in some)
    first, second = names, names
    if len(some) == 1 and count > 1:
        bare = names.strip("'")
        first, second = (
            yaml_value(f"{bare}[{part}]") for part in (f":{count // 2}", f"{count // 2}:")
        )
    yield f"    # references: {first}  # not found: which of these {count} images have no spray"
    yield f"    # injections: {second}  # not found: which of them have"


def _kind(key: str, some: Sequence[Recording], files: Files, note: str) -> Iterator[str]:
    if not some:
        yield f"    # {key}: NAMES  # not found"
        return
    count = sum(each.count for each in some)
    numbers = {
        int(found[-1]) for each in some if (found := re.findall(r"\d+", each.source.path.stem))
    }
    gaps = sorted(set(range(min(numbers, default=0), max(numbers, default=-1) + 1)) - numbers)
    if len(some) > 2 and 0 < len(gaps) <= _MOST_MISSING:
        note += f"; no number {', '.join(map(str, gaps))}"
    yield f"    {key}: {files(some)}  # {count} of {_form(some[0])}{note}"


def _patterns(names: Sequence[str], known: Sequence[str]) -> str | list[str]:
    """Names with * that match exactly these of the known names, a pattern for each folder."""
    folders: dict[str, list[str]] = {}
    for name in names:
        folders.setdefault(name.partition("::")[0].rpartition("/")[0], []).append(name)
    found: list[str] = []
    for folder, some in folders.items():
        first = re.sub(r"\d+$", "", _common(some))
        last = re.sub(r"^\d+", "", _common([name[::-1] for name in some])[::-1])
        pattern = f"{first}*{last}"
        same = [name for name in known if name.startswith(first) and name.endswith(last)
                and len(name) >= len(first) + len(last)
                and name.rpartition("/")[0] == folder]  # fmt: skip
        found += [pattern] if len(some) > 1 and same == some else some
    return found[0] if len(found) == 1 else found


def _common(names: Sequence[str]) -> str:
    """Beginning that all names share."""
    one, other = min(names), max(names)
    pairs = enumerate(zip(one, other, strict=False))
    return one[: next((n for n, (a, b) in pairs if a != b), len(one))]


def _warmth(group: tuple[tuple[float, str, str], object]) -> tuple[float, str]:
    value, unit, place = group[0]
    return value + ZERO_CELSIUS_K * (unit == "C"), place
