"""One number per image, from a table, a data set, or the YAML."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from cldit.acquisition.pictures.hdf5 import read_line
from cldit.acquisition.pictures.source import Source, parse_source
from cldit.errors import EvaluationError
from cldit.io.files import read_text


def read_numbers(
    folder: Path,
    given: Sequence[float] | str,
    *,
    column: str,
    allowed: str = "a number",
    convert: Callable[[str], float] = float,
) -> list[float]:
    """Reads numbers in the order of the images.

    Args:
        folder: base of relative paths.
        given: the numbers; or `log.csv::column` or `run.nxs::/entry/log`, with [first:last] or
            without.
        column: of a table named without one.
        allowed: description of a valid cell, for messages.
        convert: turns a cell into its number, or raises ValueError.

    Raises:
        EvaluationError: unreadable.
    """
    if not isinstance(given, str):
        return list(given)
    pattern, source = parse_source(given)
    source = replace(source, path=folder / pattern)
    try:
        if source.path.suffix.lower() in (".csv", ".txt"):
            return _column(source, column, allowed, convert)
        return [float(one) for one in read_line(source)]
    except OSError as error:
        raise EvaluationError(f"{source.text}: cannot be read ({error})") from error


def _column(
    source: Source, column: str, allowed: str, convert: Callable[[str], float]
) -> list[float]:
    lines = read_text(source.path).splitlines()
    between = ";" if lines and ";" in lines[0] else ","
    rows = list(csv.DictReader(lines, delimiter=between))
    names = [name.strip() for name in (lines[0].split(between) if lines else [])]
    name = source.dataset or column
    if name not in names:
        raise EvaluationError(f"{source.path}: no column {name}; it has {', '.join(names)}")
    found = []
    for number, row in enumerate(rows[source.first : source.last], start=source.first + 2):
        value = {key.strip(): one for key, one in row.items() if isinstance(key, str)}[name]
        try:
            found.append(convert(value if between == "," else value.replace(",", ".")))
        except (TypeError, ValueError, AttributeError) as error:
            raise EvaluationError(
                f"{source.path}, line {number}: {name} is {value!r}; allowed: {allowed}"
            ) from error
    return found
