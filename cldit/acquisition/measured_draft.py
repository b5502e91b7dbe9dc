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
from cldit.constants import ZERO_CELSIUS_K
from cldit.errors import EvaluationError
from cldit.io.files import natural_order, write_text
from cldit.io.plain_data import yaml_value
from cldit.io.text_tables import read_table_text, split_cells

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
    recordings, remarks = _recordings(folder)
    if not recordings:
        seen = f"; {remarks[0]}" if remarks else ""
        raise EvaluationError(f"{folder}: no image was found (--write-measured){seen}")
    lines = [*_lines(folder.resolve(), out.resolve().parent, recordings, remarks)]
    write_text(out, "\n".join(lines) + "\n")
    missing = [line.strip(" #-") for line in lines if "# not found" in line]
    names = dict.fromkeys(line.partition("  # not")[0].partition(":")[0] for line in missing)
    return [str(out), *(f"  not found: {name}" for name in names)]


def _recordings(folder: Path) -> tuple[list[Recording], list[str]]:
    """Images of the most frequent form, and lines on all other files that might matter."""
    reader = FrameReader()
    recordings: list[Recording] = []
    remarks: list[str] = []
    for path in sorted(_files(folder), key=natural_order):
        name = path.relative_to(folder).as_posix()
        kind = kind_of(path)
        extension = own_reader(path) is not None
        if kind is None and not extension:
            continue
        if kind is not None and not kind.reader and not extension:
            remarks.append(f"{name} is {kind.name}: {kind.way_out}")
            continue
        try:
            recordings += _opened(reader, path, name)
        except EvaluationError as error:
            columns = _columns(path) if kind is not None and kind.name == "text" else ()
            remarks.append(f"table {name}: {', '.join(columns)}" if columns else str(error))
    reader.close()
    logs = [recording for recording in recordings if min(recording.form[0]) < _SMALLEST]
    images = [recording for recording in recordings if recording not in logs]
    sizes = multimode([recording.form[0] for recording in images for _ in range(recording.count)])
    size = sizes[0] if sizes else ()
    remarks += [
        f"table {recording.name}: {', '.join(_columns(recording.source.path))}"
        for recording in logs
    ]
    remarks += [f"{recording.name}: {_form(recording)}, another size" for recording in images
               if recording.form[0] != size]  # fmt: skip
    return _distinguished([recording for recording in images if recording.form[0] == size]), remarks


def _distinguished(recordings: list[Recording]) -> list[Recording]:
    """Images with their kinds by the words that not all names have, if all have the same kind."""
    images = [
        recording
        for recording in recordings
        if recording.reported.role not in ("dark", "defective")
    ]
    if len({recording.reported.role for recording in images}) != 1:
        return recordings
    shared = set.intersection(*(set(words_of(recording.name)) for recording in images))
    reports = {recording.name: reported(recording.name, shared) for recording in images}
    if len({report.role for report in reports.values()}) < 2:
        return recordings
    return [
        replace(recording, reported=reports.get(recording.name, recording.reported))
        for recording in recordings
    ]


def _files(folder: Path) -> Iterator[Path]:
    """Files and Zarr folders, without hidden ones, and maps of an evaluation with their figure."""
    for root, folders, files in os.walk(folder):
        directory = Path(root)
        zarrs = [name for name in folders if kind_of(directory / name) is not None]
        yield from (directory / name for name in zarrs)
        folders[:] = sorted(
            name for name in folders if not (name[0] == "." or name in ("maps", *zarrs))
        )
        yield from (
            directory / name for name in files if name[0] != "." and Path(name).stem != "maps"
        )


def _opened(reader: FrameReader, path: Path, name: str) -> list[Recording]:
    try:
        return [_recording(reader, Source(path), name)]
    except NoDataSet as error:
        sets = [Source(path, dataset) for dataset in error.known]
        return [
            _recording(reader, dataset_source, f"{name}::{dataset_source.dataset}")
            for dataset_source in sets
        ]


def _recording(reader: FrameReader, source: Source, name: str) -> Recording:
    count = len(reader.metadata(source))
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


def _form(recording: Recording) -> str:
    (rows, columns), kind = recording.form
    return f"{columns} x {rows} {kind}"


def _lines(
    folder: Path, base: Path, recordings: list[Recording], remarks: list[str]
) -> Iterator[str]:
    """Lines of the draft; names are relative to `base`, the folder of the file."""
    inside = Path(os.path.relpath(folder, base)).as_posix()
    prefix = "" if inside == "." else f"{inside}/"
    names = [prefix + recording.name for recording in recordings]

    def files(selection: Sequence[Recording]) -> str:
        return yaml_value(_patterns([prefix + recording.name for recording in selection], names))

    def role(name: str) -> list[Recording]:
        return [recording for recording in recordings if recording.reported.role == name]

    images = [
        recording
        for recording in recordings
        if recording.reported.role not in ("dark", "defective")
    ]
    total, columns = sum(recording.count for recording in images), recordings[0].form[0][1]
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
    yield from _sensor(images or recordings, role("dark"))
    for recording in role("defective"):
        if recording.middle == 0.0:
            yield f"bad_pixels: {files([recording])}"
        else:
            yield f"# bad_pixels: {files([recording])}  # not found: most of its pixels are not 0"
    yield "backgrounds:"
    yield from _backgrounds(images, files)
    yield from (f"# {' '.join(line.split())}" for line in remarks)


def _sensor(images: Sequence[Recording], dark: Sequence[Recording]) -> Iterator[str]:
    high = max(recording.high for recording in images)
    bits = max(8, 2 * -(-int(high).bit_length() // 2))  # of sensors: 8, 10, 12, 14 or 16
    integer = all(recording.form[1].startswith(("uint", "int")) for recording in images)
    if integer and bits <= 16:
        yield (
            f"  saturation_counts: {2**bits - 1}  # {bits} bits: the largest count read is "
            f"{high:g}; check"
        )
    else:
        yield f"  # saturation_counts: {1.1 * high:.4g}  # not found: the largest is {high:g}"
    if dark:
        offset = float(np.median([recording.middle for recording in dark]))
        yield f"  offset_counts: {offset:g}  # median of {dark[0].name}, {len(dark)} files"


def _backgrounds(images: Sequence[Recording], files: Files) -> Iterator[str]:
    groups: dict[tuple[float, str, str], list[Recording]] = {}
    for recording in images:
        value, unit = 0.0, ""
        if recording.reported.temperature is not None:
            value, unit = recording.reported.temperature
        same = recording.name if recording.count > 1 else recording.name.rpartition("/")[0]
        place = "" if value else without_role(same)
        groups.setdefault((value, unit, place), []).append(recording)
    for (value, unit, place), group in sorted(groups.items(), key=_warmth):
        if unit:
            yield f"  - temperature_{unit}: {value:g}"
        elif value:
            yield f"  - # temperature_K: {value:g}  # not found: its unit; K, or temperature_C"
        else:
            where = place or "these images; names as 423K and T150C show it"
            yield f"  - # temperature_K: 400.0  # not found: of {where}"
        roles = {role: [recording for recording in group if recording.reported.role == role]
                 for role in ("reference", "injection", "")}  # fmt: skip
        notes: dict[str, str] = {}
        for certain, assumed in (("reference", "injection"), ("injection", "reference")):
            if roles[certain] and not roles[assumed] and roles[""]:
                roles[assumed], notes[assumed] = roles.pop(""), "; the names do not say so, check"
        rest = roles.get("", [])
        if rest and not (roles["reference"] or roles["injection"]):
            yield from _either(rest, files)
            continue
        yield from _kind("references", roles["reference"], files, notes.get("reference", ""))
        delays = sorted({recording.reported.delay_s or 0.0 for recording in roles["injection"]})
        for number, delay_s in enumerate(delays or [0.0]):
            at_delay = [
                recording
                for recording in roles["injection"]
                if (recording.reported.delay_s or 0.0) == delay_s
            ]
            several = f"; delay {1e3 * delay_s:g} ms" if len(delays) > 1 else ""
            several += ", for a file of its own" if number else ""
            for line in _kind("injections", at_delay, files, notes.get("injection", "") + several):
                yield line.replace("    inj", "    # inj") if number else line
        if rest:
            yield f"    # {files(rest)}  # not found: whether these have spray"


def _either(recordings: Sequence[Recording], files: Files) -> Iterator[str]:
    """Lines for images of either kind: two parts of a film, or the same names twice."""
    names, count = files(recordings), sum(recording.count for recording in recordings)
    references, injections = names, names
    if len(recordings) == 1 and count > 1:
        bare = names.strip("'")
        references, injections = (
            yaml_value(f"{bare}[{part}]") for part in (f":{count // 2}", f"{count // 2}:")
        )
    unknown = f"which of these {count} images have no spray"
    yield f"    # references: {references}  # not found: {unknown}"
    yield f"    # injections: {injections}  # not found: which of them have"


def _kind(key: str, recordings: Sequence[Recording], files: Files, note: str) -> Iterator[str]:
    if not recordings:
        yield f"    # {key}: NAMES  # not found"
        return
    count = sum(recording.count for recording in recordings)
    numbers = {
        int(digits[-1])
        for recording in recordings
        if (digits := re.findall(r"\d+", recording.source.path.stem))
    }
    gaps = sorted(set(range(min(numbers, default=0), max(numbers, default=-1) + 1)) - numbers)
    if 0 < len(gaps) < len(recordings) - 1:  # else they do not count the images
        note += f"; no number {', '.join(map(str, gaps))}"
    yield f"    {key}: {files(recordings)}  # {count} of {_form(recordings[0])}{note}"


def _patterns(names: Sequence[str], all_names: Sequence[str]) -> str | list[str]:
    """Names with * that match exactly these of the known names, a pattern for each folder."""
    folders: dict[str, list[str]] = {}
    for name in names:
        folders.setdefault(name.partition("::")[0].rpartition("/")[0], []).append(name)
    patterns: list[str] = []
    for folder, in_folder in folders.items():
        start = re.sub(r"\d+$", "", _common(in_folder))
        end = re.sub(r"^\d+", "", _common([name[::-1] for name in in_folder])[::-1])
        pattern = f"{start}*{end}"
        same = [name for name in all_names if name.startswith(start) and name.endswith(end)
                and len(name) >= len(start) + len(end)
                and name.rpartition("/")[0] == folder]  # fmt: skip
        patterns += [pattern] if len(in_folder) > 1 and same == in_folder else in_folder
    return patterns[0] if len(patterns) == 1 else patterns


def _common(names: Sequence[str]) -> str:
    lowest, highest = min(names), max(names)
    pairs = enumerate(zip(lowest, highest, strict=False))
    return lowest[: next((n for n, (a, b) in pairs if a != b), len(lowest))]


def _warmth(group: tuple[tuple[float, str, str], object]) -> tuple[float, str]:
    value, unit, place = group[0]
    return value + ZERO_CELSIUS_K * (unit == "C"), place
