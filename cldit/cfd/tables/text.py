"""Tables of text: with a delimiter, in any encoding, and Fluent's samples of particles (.dpm).

Two lines in parentheses name the surface and the columns of a sample; each further line is a
parcel: `((x y z ... flow-rate) injection-0:17)` (Fluent's User's Guide, "Sampling of Trajectories";
no file written by Fluent was at hand).
"""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.case import Column
from cldit.cfd.inputs import HEAD_BYTES, regular, text_of
from cldit.cfd.mapping.file import Table
from cldit.cfd.names import is_mark
from cldit.cfd.tolerances import EXACT
from cldit.errors import SprayError
from cldit.io.files import open_regular, text_encoding
from cldit.io.text_tables import delimiter_of, split_line

_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?")
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
_UNDEFINED = re.compile(  # also as Windows writes it
    r"[-+]?(?:\d\.#(?:IND|QNAN|SNAN|INF)\d*|nan\(\w*\))|n/?a|null|", re.IGNORECASE
)
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)")


class TextTable:
    """Table in a file: `names` of its columns; numbers and texts in the rows below its header.

    A name in quotes may contain the delimiter. In files of CFD-Post the header follows `[Data]`.
    """

    def __init__(self, file: Path, layout: Table) -> None:
        """Reads the header; `layout` gives its line, the delimiter and the decimal mark."""
        self._file, self._decimal, self._rows = regular(file), layout.decimal, 0
        self._encoding = text_encoding(file)
        stated = "header_line" in layout.model_fields_set
        with self._open() as stream:
            lines = [stream.readline() for _ in range(layout.header_line)]
            if not stated and lines[-1].strip() in ("", "[Name]", "[Data]"):
                head = (lines[-1] + stream.read(HEAD_BYTES)).splitlines()
                marks = [n for n, line in enumerate(head[:-1]) if line.strip() == "[Data]"]
                lines = head[: marks[0] + 2] if marks else lines
            while lines[-1].startswith("%") and not stated:
                following = stream.readline()
                if not following.startswith("%"):  # the last remark names the columns
                    break
                lines.append(following)
        self._header, self._above = lines[-1].strip(), len(lines)
        header = lines[-1].strip("\r\n ").lstrip("#%").lstrip()
        self._delimiter = layout.delimiter or delimiter_of(header)
        cells = split_line(header, self._delimiter)
        self.names = [cell.strip().strip('"').strip() for cell in cells]

    def _open(self) -> TextIO:
        return self._file.open(encoding=self._encoding, errors="replace")

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Rows below the header, with the numbers of their lines; `_rows` counts them."""
        blanks, self._rows = None if self._delimiter == " " else "\r\n ", 0
        with self._open() as stream:
            for number, raw in enumerate(stream, start=1):
                line = raw.strip(blanks)
                if number <= self._above or not line or line[0] in "#%":
                    continue
                if line.strip() == self._header:  # again, where tables were put together
                    continue
                self._rows += 1
                yield number, line.replace(",", ".") if self._decimal == "," else line

    def _readable(self, used: list[int]) -> Iterator[str]:
        """Rows of as many cells as the header, with numbers as NumPy reads them.

        Undefined and empty cells become nan, and exponents of Fortran (1.5D-3) 1.5e-3.
        """
        for number, line in self._lines():
            cells = split_line(line, self._delimiter)
            if len(cells) != len(self.names):
                raise SprayError(
                    f"{self._file}: line {number} has {len(cells)} cells, the header "
                    f"{len(self.names)} (delimiter {self._delimiter!r}); put quotes around text "
                    "that contains the delimiter, and give `delimiter` and `decimal` in the "
                    "mapping file if numbers have a comma"
                )
            for place in [] if '"' in line else used:
                cell = cells[place] = _FORTRAN.sub("e", cells[place].strip())
                if ("#" in cell or not cell[-1:].isdigit()) and _UNDEFINED.fullmatch(cell):
                    cells[place] = "nan"
            yield line if '"' in line else self._delimiter.join(cells)

    def _load(self, used: list[int], texts: dict[int, str], *, strict: bool) -> NDArray[Any]:
        """Columns that are `used` as numbers, others of the forms in `texts`, or one character."""
        form = texts | dict.fromkeys(used, "f8")
        kinds = [(str(place), form.get(place, "U1")) for place in range(len(self.names))]
        lines = self._readable(used) if strict else (line for _, line in self._lines())
        mark = None if self._delimiter == " " else self._delimiter
        return np.loadtxt(lines, kinds, delimiter=mark, ndmin=1, quotechar='"', comments=None)

    def columns(self, used: list[int], marks: list[int]) -> dict[str, Column]:
        """Columns (N,) by name: `used` ones as numbers, `marks` as numbers, or texts if named so.

        NumPy refuses rows of another length than the header; which line it is takes another
        reading. Numbers are sorted faster than texts.
        """
        named = [place for place in marks if is_mark(self.names[place])]
        if self._delimiter == self._decimal:
            problem = f"{self._delimiter!r} is both the delimiter and the decimal mark"
            raise SprayError(f"{self._file}: {problem}; allowed delimiters: ; tab space")
        self._check_last_line()
        ways = [(marks, "f8", False), (named, "U64", False), (named, "U64", True)]
        for places, form, strict in ways:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", UserWarning)  # no row: the caller's error
                    rows = self._load(used, dict.fromkeys(places, form), strict=strict)
            except SprayError:
                raise
            except ValueError as error:
                if strict:
                    raise self._no_number(used) from error
                continue
            if form != "f8" or all(np.all(np.abs(rows[str(n)]) < EXACT) for n in named):
                break
        if len(rows) != self._rows:
            counts = f"{self._rows} lines make {len(rows)} rows"
            raise SprayError(f"{self._file}: {counts}: a quote is not closed")
        labels = {place: f"{self._file}: column {self.names[place]}" for place in (*used, *places)}
        return {self.names[n]: Column(label, rows[str(n)]) for n, label in labels.items()}

    def _check_last_line(self) -> None:
        """Refuses a file whose last line has no end, as it is cut off."""
        with open_regular(self._file) as stream:
            stream.seek(max(stream.seek(0, 2) - 2, 0))
            if not stream.read().strip(b"\0").endswith((b"\n", b"\r")):
                raise SprayError(f"{self._file}: its last line has no end: the file is cut off")

    def _no_number(self, used: list[int]) -> SprayError:
        """Error that names the first cell that is no number, with advice."""
        rows = (split_line(line, self._delimiter) for line in self._readable(used))
        bad = (
            (self.names[n], row[n].strip()) for row in rows for n in used if not _is_number(row[n])
        )
        name, cell = next(bad, ("", ""))
        way = "write numbers, or leave a cell empty that has none"
        if "," in cell:
            way = "for a decimal comma give `decimal: ','` in the mapping file"
        if _THOUSANDS.fullmatch(cell):
            way = "remove the thousands separators"
        shown = f"row {self._rows} has {cell!a} in the column {name}"
        return SprayError(f"{self._file}: not all numbers: {shown}; {way}")

    def numeric(self) -> set[str]:
        """Names of the columns that have a number in the first row below the header."""
        _, row = next(self._lines(), (0, ""))
        cells = zip(self.names, split_line(row, self._delimiter), strict=False)
        return {name for name, cell in cells if name and _NUMBER.fullmatch(cell)}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


DENSITY = "mass-density"  # of a droplet: mass over volume, as Fluent gives none
_ROW = re.compile(r"\(\(([^()]*)\)\s*([^()\s]*)\s*\)\s*$")


def dpm_names(file: Path) -> list[str]:
    """Names of the columns; with `DENSITY` if mass and diameter are among them."""
    return _named(file, text_of(file).splitlines())


def _named(file: Path, lines: list[str]) -> list[str]:
    head = [line.strip() for line in lines[:2]]
    if len(head) < 2 or not all(re.fullmatch(r"\([^()]+\)", line) for line in head):
        raise SprayError(
            f"{file}: does not begin with Fluent's two lines, (surface count) and (x y z ... name)"
        )
    names = head[1][1:-1].split()
    if names[-1] == "name":
        names.pop()
    return [*names, *([DENSITY] if {"mass", "diameter"} <= set(names) else [])]


def dpm_columns(file: Path) -> dict[str, Column]:
    """All columns (N,) by name."""
    content = text_of(file)
    names = _named(file, content.splitlines())
    written = [name for name in names if name != DENSITY]
    rows = []
    for number, line in enumerate(content.splitlines()[2:], start=3):
        if not line.strip():
            continue
        match = _ROW.match(line.strip())
        try:
            row = [] if match is None else [float(part) for part in match[1].split()]
        except ValueError:
            row = []
        if len(row) != len(written):
            layout = f"{len(written)} numbers in double parentheses, and a name"
            raise SprayError(f"{file}: line {number}: expected: {layout}")
        rows.append(row)
    if not rows or not content.endswith("\n"):
        raise SprayError(f"{file}: " + ("no parcel in it" if not rows else "is cut off"))
    table = np.array(rows)
    columns = {
        name: Column(f"{file}: column {name}", table[:, place])
        for place, name in enumerate(written)
    }
    if DENSITY in names:
        diameter = columns["diameter"].values
        if not np.all(diameter >= 0):
            bad = int(np.argmin(diameter >= 0))
            label = columns["diameter"].label
            raise SprayError(f"{label}: {diameter[bad]:g} (entry {bad}) is not a size")
        volume = np.where(diameter > 0, np.pi / 6 * diameter**3, np.nan)  # none of a dummy
        density = columns["mass"].values / volume
        columns[DENSITY] = Column(f"{file}: columns mass and diameter", density)
    return columns
