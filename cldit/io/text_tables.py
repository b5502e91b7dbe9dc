"""Tables of numbers in text, as programs export them: header rows, separators, decimal commas."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cldit.io.files import read_text, text_encoding

_COMMA_IN_NUMBERS = re.compile(r"\d,\d+[ \t]+[-+]?\d")  # 20,1 20,3: blanks between the numbers


@dataclass(frozen=True)
class NumberRow:
    """A line of numbers: its number in the file, its label, and the block of lines it belongs to.

    label: text of a first cell that is no number; None without one. Blank lines separate blocks.
    """

    line: int
    label: str | None
    values: list[float]
    block: int


@dataclass(frozen=True)
class NumberTable:
    """Lines above the first row of numbers, and rows of one length."""

    header: list[str]
    rows: list[NumberRow]


def read_table_text(path: Path) -> str:
    """Text of a table in UTF-8, UTF-16 or cp1252; raises FileError as `read_text`."""
    return read_text(path, encoding=text_encoding(path))


def delimiter_of(line: str) -> str:
    """First of semicolon, tab and comma that a line has outside quotes; else a blank."""
    plain = re.sub(r'"[^"]*"', "", line)
    return next((mark for mark in ";\t," if mark in plain), " ")


def split_line(line: str, delimiter: str) -> list[str]:
    """Cells of a line as they are; a cell in quotes may contain the delimiter."""
    if '"' not in line:
        return line.split() if delimiter == " " else line.split(delimiter)
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def split_cells(line: str) -> tuple[list[str], str]:
    """Cells of a line, and what separates them: a semicolon, a tab, a comma or blanks.

    A comma within a cell is a decimal point. An empty last cell, which many programs write, is
    omitted.
    """
    between = delimiter_of(line)
    if between == "," and _COMMA_IN_NUMBERS.search(re.sub(r'"[^"]*"', "", line)):
        between = " "
    cells = [cell.strip() for cell in split_line(line.strip("\r\n "), between)]
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells, between


def number_table(table: str) -> NumberTable:
    """Numbers of a table with one row per line; the lines above the first full row are its header.

    A line of numbers above a full row is a header only if it is another size line of the table,
    `columns rows`. Raises ValueError if there are no numbers, or a line below the header has
    anything else, or another count of numbers.
    """
    parsed_lines: list[tuple[int, str, str | None, list[float] | None]] = []
    for number, line in enumerate(table.splitlines(), start=1):
        parsed_lines.append((number, line, *_numbers(line)))
    widest = max((len(values) for *_, values in parsed_lines if values), default=0)
    if not widest:
        raise ValueError("has no line of numbers")
    begin = next(
        n for n, (*_, values) in enumerate(parsed_lines) if values and len(values) == widest
    )
    rows: list[NumberRow] = []
    block = 0
    for number, line, label, values in parsed_lines[begin:]:
        if not line.strip():
            block += bool(rows) and rows[-1].block == block
            continue
        if values is None:
            raise ValueError(f"line {number}: {line.strip()[:40]!r}; allowed: numbers only")
        if len(values) != widest or (rows and (label is None) != (rows[0].label is None)):
            raise ValueError(f"line {number}: {len(values)} numbers, expected {widest}")
        rows.append(NumberRow(number, label, values, block))
    header = []
    for number, line, label, values in parsed_lines[:begin]:
        if values and label is None and values != [widest, len(rows)]:
            raise ValueError(f"line {number}: {len(values)} numbers, expected {widest}")
        header += [line.strip()] if line.strip() else []
    return NumberTable(header, rows)


def _numbers(line: str) -> tuple[str | None, list[float] | None]:
    """Label and numbers of a line; None for a line that has anything else."""
    cells = [cell.replace(",", ".") for cell in split_cells(line)[0]]
    for label, rest in ((None, cells), (cells[0] if cells else None, cells[1:])):
        values = _floats(rest)
        if values:
            return label, values
    return None, None


def _floats(cells: Sequence[str]) -> list[float] | None:
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return None


def csv_text(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """CSV with a heading, and a line for each of the `rows`."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([heads, *rows])
    return stream.getvalue()
