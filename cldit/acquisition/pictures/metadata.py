"""Values of each image: time, exposure and temperature, from tables, data sets or the files.

Of the files, only metadata that a format defines is read: headers of Telops' films, OME-XML, and
NeXus' NXdetector. TIFF's own date (tag 306) is that of the file, which an export renews.
"""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from cldit.acquisition.pictures.kinds import kind_of
from cldit.acquisition.pictures.source import ImageMetadata, Source, moment_s, parse_source
from cldit.constants import ZERO_CELSIUS_K
from cldit.errors import EvaluationError, reason
from cldit.io.text_tables import read_table_text, split_cells, split_line
from cldit.rig.checks import ROUNDING

_SAME_s = 1.0  # clocks that show whole seconds
_FAR_K = 30.0  # from the set point: another unit, or another column


def read_numbers(
    folder: Path,
    stated: Sequence[float] | str,
    *,
    column: str,
    allowed: str = "a number",
    convert: Callable[[str], float] = float,
) -> list[float]:
    """Reads numbers in the order of the images.

    They are `stated` as such, or as `log.csv::column` or `run.nxs::/entry/log` in `folder`, with
    [first:last] or without; `column` is that of a table named without one. `convert` turns a cell
    into its number, or raises ValueError. Raises EvaluationError for an unreadable one.
    """
    if not isinstance(stated, str):
        return list(stated)
    pattern, source = parse_source(stated)
    source = replace(source, path=folder / pattern)
    try:
        kind = kind_of(source.path)
        if kind is None or not kind.line:
            return _column(source, column, allowed, convert)
        return [float(number) for number in kind.load(kind.line)(source)]
    except (OSError, ValueError) as error:
        if isinstance(error, EvaluationError):
            raise
        raise EvaluationError(f"{source.text}: cannot be read ({reason(error)})") from error


def _column(
    source: Source, column: str, allowed: str, convert: Callable[[str], float]
) -> list[float]:
    """Cells below the first line that names the column; lines above it, and a line of units below
    it, are header rows.
    """
    file_lines = read_table_text(source.path).splitlines()
    lines = [(number, line) for number, line in enumerate(file_lines, start=1) if line.strip()]
    name = source.dataset or column
    rest = iter(lines)
    for _, line in rest:
        header, between = split_cells(line)
        if line.strip() == name:  # alone, and maybe with blanks
            header, between = [name], ","
        if name in header:
            break
    else:
        columns = next((cells for _, line in lines if len(cells := split_cells(line)[0]) > 1), [])
        raise EvaluationError(
            f"{source.path}: no column {name}; it has {', '.join(columns) or 'none'}"
        )
    place = header.index(name)
    below = list(rest)
    if below and not re.search(r"\d", below[0][1]):
        below = below[1:]
    numbers = []
    for number, line in below[source.part]:
        row = split_line(line, between)
        value = row[place].strip() if place < len(row) else ""
        try:
            numbers.append(convert(value.replace(",", ".")))
        except ValueError as error:
            raise EvaluationError(
                f"{source.path}, line {number}: {name} is {value!r}; allowed: {allowed}"
            ) from error
    return numbers


def _one_each(
    values: list[float], stated: Sequence[float] | str, *, where: str, count: int, quantity: str
) -> str:
    """Text of the values as `stated`; raises EvaluationError unless there is one an image."""
    listed = stated if isinstance(stated, str) else str(list(stated))
    if len(values) != count:
        raise EvaluationError(
            f"{where}: {count} images and {len(values)} {quantity} ({listed}); allowed: one each"
        )
    return listed


def read_temperatures(
    folder: Path,
    stated: Sequence[float] | str,
    *,
    where: str,
    count: int,
    setpoint_K: float,
    zero_K: float = 0.0,
) -> list[float]:
    """Reads `count` temperatures in kelvin, as `read_numbers`, from a unit with its zero at
    `zero_K`. Raises EvaluationError also if one is far from the set point.
    """
    column = "temperature_C" if zero_K else "temperature_K"
    kelvins = [zero_K + number for number in read_numbers(folder, stated, column=column)]
    listed = _one_each(kelvins, stated, where=where, count=count, quantity="temperatures")
    for number, kelvin in enumerate(kelvins):
        if not (math.isfinite(kelvin) and abs(kelvin - setpoint_K) <= _FAR_K):
            off_K = kelvin + ZERO_CELSIUS_K - setpoint_K
            hint = ", degrees Celsius?" if abs(off_K) <= _FAR_K else ""
            raise EvaluationError(
                f"{where}: temperature {number} is {kelvin:g}{hint} ({listed}); allowed: kelvin "
                f"within {_FAR_K:g} K of temperature_K"
            )
    return kelvins


def _number_or_moment(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return moment_s(cell)


def read_times(
    folder: Path, stated: Sequence[float] | str, *, where: str, count: int
) -> list[float]:
    """Reads `count` times in seconds, as `read_numbers`; a table may contain dates in ISO 8601.
    Raises EvaluationError also if they do not rise.
    """
    times = read_numbers(
        folder,
        stated,
        column="time_s",
        allowed="seconds, or a date as 2026-01-31T12:00:00",
        convert=_number_or_moment,
    )
    listed = _one_each(times, stated, where=where, count=count, quantity="times")
    for number, (earlier, later) in enumerate(pairwise(times), start=1):
        if not later > earlier:
            raise EvaluationError(
                f"{where}: time {number} is {later:.10g} s after {earlier:.10g} s ({listed}); they "
                "must rise in the order of the images"
            )
    if not all(math.isfinite(time_s) for time_s in times):
        raise EvaluationError(f"{where}: times that are not finite ({listed})")
    return times


def check_exposures(
    images: Iterable[tuple[str, ImageMetadata]], stated_s: float | None
) -> float | None:
    """Common exposure of all images with a known one, in seconds; None if there is none.

    `images` pairs a name with the metadata of its image; `stated_s` is `integration_time_s` of the
    YAML. Raises EvaluationError if two exposures differ.
    """
    exposures = [
        (name, metadata.integration_time_s)
        for name, metadata in images
        if metadata.integration_time_s
    ]
    if not exposures:
        return None
    name, first_s = exposures[0]
    if stated_s is not None and abs(first_s - stated_s) > ROUNDING * stated_s:
        raise EvaluationError(
            f"{name}: exposed for {1e6 * first_s:g} us by its file; integration_time_s says "
            f"{1e6 * stated_s:g} us: correct it, or take the right files"
        )
    for differing, exposed_s in exposures[1:]:
        if abs(exposed_s - first_s) > ROUNDING * first_s:
            raise EvaluationError(
                f"{differing}: exposed for {1e6 * exposed_s:g} us by its file, {name} for "
                f"{1e6 * first_s:g} us; references and injections need one exposure"
            )
    return first_s


def check_times(images: Iterable[tuple[str, ImageMetadata, float | None]]) -> None:
    """Compares the times of the YAML with those of the files; both may start anywhere.

    `images` has for each image its name, its metadata and its time in the YAML in seconds. Raises
    EvaluationError if the two differ by more than a second from one image to another.
    """
    gaps_s = [
        (name, stated_s - metadata.time_s)
        for name, metadata, stated_s in images
        if metadata.time_s is not None and stated_s is not None
    ]
    for name, gap_s in gaps_s[1:]:
        if abs(gap_s - gaps_s[0][1]) > _SAME_s:
            raise EvaluationError(
                f"{name}: {gap_s - gaps_s[0][1]:+.3g} s later after {gaps_s[0][0]} by "
                "measured.yaml than by the files; leave the times out of the YAML, or correct them"
            )


def metadata_lines(images: Sequence[tuple[ImageMetadata, float | None]]) -> list[str]:
    """Summary of exposures and times of all images, a line each; `images` pairs the metadata of an
    image with the time that the evaluation uses.
    """
    lines = []
    exposed = [metadata.integration_time_s for metadata, _ in images if metadata.integration_time_s]
    if exposed:
        lines.append(f"exposure {1e6 * exposed[0]:g} us, by {len(exposed)} of {len(images)} images")
    times = [time_s for _, time_s in images if time_s is not None]
    if times:
        lines.append(f"times of {len(times)} of {len(images)} images, over {np.ptp(times):.4g} s")
    return lines
