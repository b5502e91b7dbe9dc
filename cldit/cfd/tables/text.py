"""Tables of text with a delimiter: header, encoding, and columns as numbers."""

import codecs
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.case import Column
from cldit.cfd.inputs import regular
from cldit.cfd.mapping.file import Table
from cldit.cfd.names import is_mark
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.text_tables import delimiter_of, split_line


def text_names(file: Path, table: Table) -> list[str]:
    """Names in the header of a file; `table` gives the header's line and delimiter."""
    return _header(file, table).names


@dataclass(frozen=True)
class _Header:
    """Names, delimiter, number of the line, and the line itself."""

    names: list[str]
    delimiter: str
    number: int
    line: str


def _header(file: Path, table: Table) -> _Header:
    """Header of a table; a name in quotes may contain the delimiter. CFD-Post's follows [Data]."""
    stated = "header_line" in table.model_fields_set
    try:
        with _opened_text(regular(file)) as stream:
            lines = [stream.readline() for _ in range(table.header_line)]
            if not stated and lines[-1].strip() in ("", "[Name]", "[Data]"):
                lines += [stream.readline() for _ in range(_HEAD_LINES)]
                marks = [n for n, line in enumerate(lines) if line.strip() == "[Data]"]
                del lines[marks[0] + 2 if marks else table.header_line :]
            number = len(lines)
            while lines[-1].startswith("%") and not stated:
                following = stream.readline()
                if not following.startswith("%"):  # the last remark names the columns
                    break
                lines.append(following)
    except SprayError:
        raise
    except (OSError, UnicodeError) as error:
        raise SprayError(f"{file}: cannot be read ({error})") from error
    line = lines[-1].encode("utf-8", "surrogateescape")
    header = _decoded(line).strip("\r\n ").lstrip("#%").lstrip()
    mark = table.delimiter or delimiter_of(header)
    names = [part.strip().strip('"').strip() for part in split_line(header, mark)]
    return _Header(names, mark, number, lines[-1].strip())


def _encoding(file: Path) -> str:
    """UTF-16 if the file begins with its mark; else UTF-8, whose invalid bytes are kept."""
    with open_regular(file) as stream:
        marked = stream.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    return "utf-16" if marked else "utf-8-sig"


def _opened_text(file: Path) -> TextIO:
    return file.open(encoding=_encoding(file), errors="surrogateescape")


def _decoded(line: bytes) -> str:
    """Text in UTF-8, else in cp1252, as spreadsheets on Windows write."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


_HEAD_LINES = 20  # in which [Data] follows [Name] in a file of CFD-Post
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?")
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
_EXACT = 2.0**53  # whole numbers below are exact as floats
_UNDEFINED = re.compile(  # also as Windows writes it
    r"[-+]?(?:\d\.#(?:IND|QNAN|SNAN|INF)\d*|nan\(\w*\))|n/?a|null|", re.IGNORECASE
)
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)")


def _readable(line: str, delimiter: str, used: list[int]) -> str:
    """Replaces undefined and empty cells by nan, and exponents of Fortran (1.5D-3) by 1.5e-3."""
    if '"' in line:
        return line
    cells = split_line(line, delimiter)
    for place in used:
        cell = cells[place].strip()
        if "D" in cell or "d" in cell:
            cell = cells[place] = _FORTRAN.sub("e", cell)
        if ("#" in cell or not cell[-1:].isdigit()) and _UNDEFINED.fullmatch(cell):
            cells[place] = "nan"
    return delimiter.join(cells)


def text_columns(
    file: Path, names: list[str], used: list[int], table: Table, marks: list[int]
) -> dict[str, Column]:
    """Columns (N,) by name: those `used` as numbers, and `marks` as numbers, or texts if named so.

    NumPy refuses rows of another length than the header; which line it is takes a second reading.
    """
    named = [place for place in marks if is_mark(names[place])]
    header = _header(file, table)
    delimiter = header.delimiter
    if delimiter == table.decimal:
        problem = f"{delimiter!r} is both the delimiter and the decimal mark"
        raise SprayError(f"{file}: {problem}; allowed delimiters: ; tab space")
    _check_last_line(file)
    count = 0

    def lines(check: bool) -> Iterator[str]:
        nonlocal count
        count = 0
        blanks = None if delimiter == " " else "\r\n "
        with _opened_text(file) as stream:
            for number, raw in enumerate(stream, start=1):
                line = raw.strip(blanks)
                if number <= header.number or not line or line[0] in "#%":
                    continue
                if line.strip() == header.line:  # again, where tables were put together
                    continue
                if check and (cells := len(split_line(line, delimiter))) != len(names):
                    raise SprayError(
                        f"{file}: line {number} has {cells} cells, the header {len(names)} "
                        f"(delimiter {delimiter!r}); put quotes around text that contains the "
                        "delimiter, and give `delimiter` and `decimal` in the mapping file if "
                        "numbers have a comma"
                    )
                count += 1
                line = line.replace(",", ".") if table.decimal == "," else line
                yield _readable(line, delimiter, used) if check else line

    def load(check: bool, mark_form: str) -> NDArray[Any]:
        held = marks if mark_form == "f8" else named
        form = dict.fromkeys(held, mark_form) | dict.fromkeys(used, "f8")
        # of the others one character is kept
        kinds = [(str(place), form.get(place, "U1")) for place in range(len(names))]
        mark = None if delimiter == " " else delimiter
        return np.loadtxt(
            lines(check), kinds, delimiter=mark, ndmin=1, quotechar='"', comments=None
        )

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no row: the caller's error
            for mark_form in ("f8", "U64")[: 1 + bool(marks)]:  # numbers are sorted faster
                try:
                    rows = load(False, mark_form)
                except ValueError:
                    continue
                numbers = [rows[str(place)] for place in named if mark_form == "f8"]
                if all(np.all(np.abs(values) < _EXACT) for values in numbers):
                    break
            else:
                rows = load(True, mark_form := "U64")
    except (ValueError, OSError) as error:
        if isinstance(error, SprayError):
            raise
        cells = ((split_line(line, delimiter), place) for line in lines(True) for place in used)
        bad = ((names[at], row[at].strip()) for row, at in cells if not _is_number(row[at]))
        name, cell = next(bad, ("", ""))
        shown = f"{cell!a} in the column {name}"
        way = _way_to_numbers(cell)
        raise SprayError(f"{file}: not all numbers: row {count} has {shown}; {way}") from error
    if len(rows) != count:
        raise SprayError(f"{file}: {count} lines make {len(rows)} rows: a quote is not closed")
    return {
        names[place]: Column(f"{file}: column {names[place]}", rows[str(place)])
        for place in (*used, *(marks if mark_form == "f8" else named))
    }


def _check_last_line(file: Path) -> None:
    """Refuses a file whose last line has no end, as it is cut off."""
    with open_regular(file) as stream:
        stream.seek(max(stream.seek(0, 2) - 2, 0))
        if not stream.read().strip(b"\0").endswith((b"\n", b"\r")):
            raise SprayError(f"{file}: its last line has no end: the file is cut off")


def _way_to_numbers(cell: str) -> str:
    """Advice on a cell that is no number."""
    if _THOUSANDS.fullmatch(cell):
        return "remove the thousands separators"
    if "," in cell:
        return "for a decimal comma give `decimal: ','` in the mapping file"
    return "write numbers, or leave a cell empty that has none"


def numbers_in(file: Path, names: list[str], table: Table) -> set[str]:
    """Names of the columns that have a number in the first row below the header."""
    header = _header(file, table)
    with _opened_text(regular(file)) as stream:
        rows = (line.strip() for n, line in enumerate(stream) if n >= header.number)
        row = next((line for line in rows if line and line[0] not in "#%"), "")
    cells = zip(names, split_line(row, header.delimiter), strict=False)
    decimal = str.maketrans(table.decimal, ".")
    return {name for name, cell in cells if name and _NUMBER.fullmatch(cell.translate(decimal))}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
