"""Readings of the black body, one a picture, from where a laboratory writes them."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cldit.acquisition.pictures.hdf5 import read_line
from cldit.acquisition.pictures.source import Source, parse_source
from cldit.errors import EvaluationError
from cldit.files import read_text

_FAR_K = 30.0  # from the set point: another unit, or another column


def read_temperatures(
    folder: Path, given: Sequence[float] | str, *, where: str, count: int, setpoint_K: float
) -> list[float]:
    """Readings in kelvin, in the order of the pictures.

    Args:
        folder: where relative paths start.
        given: the numbers; or `log.csv::column` or `run.nxs::/entry/log`, with [first:last] or not.
        where: which pictures, for messages.
        count: how many pictures there are.
        setpoint_K: near which the readings must be.

    Returns:
        One reading a picture [K].

    Raises:
        EvaluationError: unreadable, another number than pictures, or far from the set point.
    """
    text = str(list(given)) if not isinstance(given, str) else given
    if isinstance(given, str):
        pattern, source = parse_source(given)
        source = replace(source, path=folder / pattern)
        by_column = source.path.suffix.lower() in (".csv", ".txt")
        try:
            found = _column(source) if by_column else [float(one) for one in read_line(source)]
        except OSError as error:
            raise EvaluationError(f"{source.text}: cannot be read ({error})") from error
    else:
        found = list(given)
    if len(found) != count:
        raise EvaluationError(
            f"{where}: {count} pictures and {len(found)} temperatures ({text}); allowed is one each"
        )
    for number, kelvin in enumerate(found):
        if not (math.isfinite(kelvin) and abs(kelvin - setpoint_K) <= _FAR_K):
            hint = ", degrees Celsius?" if abs(kelvin + 273.15 - setpoint_K) <= _FAR_K else ""
            raise EvaluationError(
                f"{where}: temperature {number} is {kelvin:g}{hint} ({text}); allowed are kelvin "
                f"within {_FAR_K:g} K of temperature_K"
            )
    return found


def _column(source: Source) -> list[float]:
    lines = read_text(source.path).splitlines()
    between = ";" if lines and ";" in lines[0] else ","
    rows = list(csv.DictReader(lines, delimiter=between))
    names = [name.strip() for name in (lines[0].split(between) if lines else [])]
    name = source.dataset or "temperature_K"
    if name not in names:
        raise EvaluationError(f"{source.path}: no column {name}; it has {', '.join(names)}")
    found = []
    for number, row in enumerate(rows[source.first : source.last], start=source.first + 2):
        value = {key.strip(): one for key, one in row.items() if isinstance(key, str)}[name]
        try:
            found.append(float(value if between == "," else value.replace(",", ".")))
        except (TypeError, ValueError, AttributeError) as error:
            raise EvaluationError(
                f"{source.path}, line {number}: {name} is {value!r}; allowed is a number"
            ) from error
    return found
