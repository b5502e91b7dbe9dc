"""Tables of cells and parcels, for codes whose own files are not read.

Text with a delimiter, Parquet, and Fluent's samples of particles (.dpm). In a .dpm file two lines
in parentheses name the surface and the columns; each further line is a parcel:
`((x y z ... flow-rate) injection-0:17)` (Fluent's User's Guide, "Sampling of Trajectories"; no file
written by Fluent was at hand).
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.case import NO_CLOUD, CfdCase, Cloud, Column, Listing, complete_cloud
from cldit.cfd.inputs import regular, text_of
from cldit.cfd.mapping.columns import Source, cloud_columns, gas_columns
from cldit.cfd.mapping.file import (
    CellColumns,
    ColumnMap,
    ParcelColumns,
    columns_of,
    read_column_map,
    without_unit,
)
from cldit.cfd.mesh.elements import BoxMesh
from cldit.cfd.one_state import check_marks, is_mark
from cldit.cfd.size import Size, check_room
from cldit.cfd.times import choose_time
from cldit.errors import SprayError
from cldit.io.files import open_regular, text_encoding
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Floats


def read_tables(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads the tables that a mapping file names, relative to it.

    A cell is a box about its centre: of edges `size`, or a cube of its `volume`.
    """
    path = spec.file
    mapping = read_column_map(path)
    if mapping.cells.file is None:
        raise SprayError(f"{path}: cells.file is missing; it names the table of the gas")
    file = path.parent / mapping.cells.file
    check_room(file, _size(file))
    watch(f"reading {file.name}", 0, 1)
    source = load_table(file, mapping.cells)
    position, edges = _boxes(source, mapping.cells)
    if mapping.time_s is not None:
        choose_time(str(path), [mapping.time_s], spec.time_s)
    elif spec.time_s is not None:
        raise SprayError(f"{path}: does not state its time (time_s); remove spray.time_s")
    if spec.cloud not in (None, NO_CLOUD, "parcels"):
        raise SprayError(f"{path}: no cloud {spec.cloud!r} (spray.cloud); available: parcels")
    drops = None if spec.cloud == NO_CLOUD else mapping.parcels
    parcels = [] if drops is None or drops.file is None else [path.parent / drops.file]
    return CfdCase(
        source=str(file),
        time_s=mapping.time_s,
        mesh=BoxMesh(position.values - edges / 2, position.values + edges / 2, position.label),
        gas=gas_columns(source, mapping.cells, spec.fuel_field),
        available=tuple(source.columns),
        cloud=None if drops is None else table_cloud(path, mapping),
        files=(path, file, *parcels),
    )


def list_tables(spec: CfdSpray) -> Listing:
    """Lists time [s] and columns of the tables that a mapping file names."""
    mapping = read_column_map(spec.file)
    found = {
        name: [] if part.file is None else table_names(spec.file.parent / part.file, part)
        for name, part in (("cells", mapping.cells), ("parcels", mapping.parcels))
        if part is not None
    }
    return [] if mapping.time_s is None else [mapping.time_s], found.pop("cells"), found


def _size(file: Path) -> Size:
    """Estimate from the mean length of the first lines: ten columns of numbers, and boxes."""
    if file.suffix == ".parquet":
        rows = int(_opened(file).metadata.num_rows)
        return Size(rows, 0, 200.0 * rows)
    try:
        with open_regular(file) as stream:
            head = stream.read(1 << 16)
        rows = file.stat().st_size * head.count(b"\n") // max(len(head), 1)
    except OSError:  # the reader reports it
        rows = 0
    return Size(rows, 0, 200.0 * rows)


def _boxes(source: Source, wanted: CellColumns) -> tuple[Column, Floats]:
    """Centres and edges of the cells, (N, 3) each."""
    if wanted.position is None or (wanted.size is None) == (wanted.volume is None):
        raise SprayError(
            f"{source.name}: cells need position, and either size or volume, in the mapping file"
        )
    position = source.vector(wanted.position, "cells.position")
    if wanted.size is not None:
        size = source.vector(wanted.size, "cells.size")
    else:
        assert wanted.volume is not None
        volume = source.scalar(wanted.volume, "cells.volume")
        size = Column(volume.label, np.cbrt(volume.values)[:, None].repeat(3, axis=1))
    good = np.all((size.values > 0.0) & np.isfinite(size.values), axis=1)
    if not good.all():
        bad = int(np.argmin(good))
        raise SprayError(f"{size.label}: cell {bad} has no volume (edges {size.values[bad]} m)")
    return position, np.asarray(size.values, np.float64)


def table_cloud(path: Path, mapping: ColumnMap) -> Cloud | None:
    """Parcels of the table that the mapping file `path` names; None if it names none."""
    wanted = mapping.parcels
    if wanted is None:
        return None
    if wanted.file is None or wanted.position is None:
        raise SprayError(f"{path}: parcels.file and parcels.position are both needed")
    file = path.parent / wanted.file
    table = load_table(file, wanted)
    position = table.vector(wanted.position, "parcels.position")
    fields = cloud_columns(table, wanted)
    return complete_cloud("parcels", str(file), position, fields, table.columns)


def table_names(file: Path, wanted: CellColumns | ParcelColumns) -> list[str]:
    """Names in the header of a table; `wanted` gives the header's line and delimiter."""
    readers = {".parquet": parquet_names, ".dpm": dpm_names}
    names = readers[file.suffix](file) if file.suffix in readers else _header(file, wanted)[0]
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice or not any(names):
        what = f"the column {twice[0]!r} twice" if twice else "no names of columns"
        raise SprayError(f"{file}: its header has {what}")
    return names


def _header(file: Path, wanted: CellColumns | ParcelColumns) -> tuple[list[str], str]:
    """Names and delimiter; a name in quotes may contain the delimiter."""
    try:
        with regular(file).open(encoding=text_encoding(file)) as stream:
            lines = [stream.readline() for _ in range(wanted.header_line)]
            while lines[-1].startswith("%") and "header_line" not in wanted.model_fields_set:
                following = stream.readline()
                if not following.startswith("%"):  # the last remark names the columns
                    break
                lines.append(following)
    except SprayError:
        raise
    except (OSError, UnicodeDecodeError) as error:
        raise SprayError(f"{file}: cannot be read ({error})") from error
    header = lines[-1].strip("\r\n ").lstrip("#%").lstrip()
    delimiter = wanted.delimiter or _delimiter(header)
    return [part.strip().strip('"').strip() for part in _split(header, delimiter)], delimiter


_UNDEFINED = re.compile(r"[-+]?\d\.#(?:IND|QNAN|SNAN|INF)\d*|", re.IGNORECASE)  # of Windows
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)")


def _readable(line: str, delimiter: str, used: list[int]) -> str:
    """Replaces undefined and empty cells by nan, and exponents of Fortran (1.5D-3) by 1.5e-3."""
    if '"' in line:
        return line
    cells = _split(line, delimiter)
    for place in used:
        cell = cells[place].strip()
        cells[place] = "nan" if _UNDEFINED.fullmatch(cell) else _FORTRAN.sub("e", cell)
    return delimiter.join(cells)


def _delimiter(header: str) -> str:
    """Delimiter of a header: the first of semicolon, tab and comma outside quotes, or space."""
    plain = re.sub(r'"[^"]*"', "", header)
    return next((mark for mark in ";\t," if mark in plain), " " if " " in plain else ",")


def _split(line: str, delimiter: str) -> list[str]:
    """Cells of a line; a cell in quotes may contain the delimiter."""
    if '"' not in line:
        return line.split() if delimiter == " " else line.split(delimiter)
    rows = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    return next(rows, [])


def load_table(file: Path, wanted: CellColumns | ParcelColumns) -> Source:
    """Reads the columns of a table that the mapping `wanted` uses; the others are only named."""
    names = table_names(file, wanted)
    mapped = columns_of(wanted)
    used = [n for n, name in enumerate(names) if {name, without_unit(name)} & mapped]
    if not used:
        raise SprayError(f"{file}: none of the mapped columns; it has: {', '.join(names)}")
    marks = [name for n, name in enumerate(names) if n not in used and _is_mark(file, name)]
    if file.suffix == ".parquet":
        read = parquet_columns(file, [*(names[place] for place in used), *marks])
    elif file.suffix == ".dpm":
        read = dpm_columns(file)
    else:
        texts = [names.index(name) for name in marks]
        rows = _numbers(file, names, used, wanted, texts)
        labels = {str(place): f"{file}: column {names[place]}" for place in (*used, *texts)}
        read = {names[int(n)]: Column(label, rows[n]) for n, label in labels.items()}
    check_marks([read[name] for name in marks], marks)
    columns = {name: Column(f"{file}: column {name}", np.empty(0)) for name in names if name}
    columns |= {names[place]: read[names[place]] for place in used}
    count = len(columns[names[used[0]]].values)
    if not count:
        raise SprayError(f"{file}: no row below its header")
    return Source(str(file), columns, count)


def _is_mark(file: Path, name: str) -> bool:
    """True for a column of time or identity; `time` of a .dpm file is the age of a particle."""
    if not is_mark(name) or (file.suffix == ".dpm" and name == "time"):
        return False
    return file.suffix != ".parquet" or str(_kind(file, name)) in _NUMBERS


def _numbers(
    file: Path,
    names: list[str],
    used: list[int],
    wanted: CellColumns | ParcelColumns,
    texts: list[int],
) -> NDArray[Any]:
    """Rows (N,) with the `used` columns as numbers and `texts` as texts.

    The others are kept as one character.

    NumPy refuses rows of another length than the header; which line it is takes a second reading.
    """
    _, delimiter = _header(file, wanted)
    if delimiter == wanted.decimal:
        what = f"{delimiter!r} is both the delimiter and the decimal mark"
        raise SprayError(f"{file}: {what}; allowed delimiters: ; tab space")
    with open_regular(file) as stream:
        stream.seek(0, 2)
        stream.seek(max(stream.tell() - 2, 0))
        if stream.read().rstrip(b"\0")[-1:] not in (b"\n", b"\r"):  # UTF-16 has two bytes
            raise SprayError(f"{file}: its last line has no end: the file is cut off")
    kind = dict.fromkeys(texts, "U32") | dict.fromkeys(used, "f8")
    kinds = [(str(place), kind.get(place, "U1")) for place in range(len(names))]
    count, encoding = 0, text_encoding(file)

    def lines(check: bool) -> Iterator[str]:
        nonlocal count
        count = 0
        blanks = None if delimiter == " " else "\r\n "
        with file.open(encoding=encoding) as stream:
            for number, raw in enumerate(stream, start=1):
                line = raw.strip(blanks)
                if number <= wanted.header_line or not line or line[0] in "#%":
                    continue
                if check and (cells := len(_split(line, delimiter))) != len(names):
                    raise SprayError(
                        f"{file}: line {number} has {cells} cells, the header {len(names)} "
                        f"(delimiter {delimiter!r}); put quotes around text that contains the "
                        "delimiter, and give `delimiter` and `decimal` in the mapping file if "
                        "numbers have a comma"
                    )
                count += 1
                line = line.replace(",", ".") if wanted.decimal == "," else line
                yield _readable(line, delimiter, used) if check else line

    def load(check: bool) -> NDArray[Any]:
        mark = None if delimiter == " " else delimiter
        return np.loadtxt(
            lines(check), kinds, delimiter=mark, ndmin=1, quotechar='"', comments=None
        )

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no row: the caller's error
            try:
                rows = load(check=False)
            except ValueError:
                rows = load(check=True)
    except (ValueError, OSError) as error:
        if isinstance(error, SprayError):
            raise
        shown = ", ".join(names[place] for place in used)
        raise SprayError(
            f"{file}: its columns {shown} are not all numbers ({error}); for a decimal comma give "
            "`decimal: ','` in the mapping file"
        ) from error
    if len(rows) != count:
        raise SprayError(f"{file}: {count} lines make {len(rows)} rows: a quote is not closed")
    return rows


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
    text = text_of(file)
    names = _named(file, text.splitlines())
    written = [name for name in names if name != DENSITY]
    rows = []
    for number, line in enumerate(text.splitlines()[2:], start=3):
        if not line.strip():
            continue
        match = _ROW.match(line.strip())
        try:
            row = [] if match is None else [float(part) for part in match[1].split()]
        except ValueError:
            row = []
        if len(row) != len(written):
            what = f"{len(written)} numbers in double parentheses, and a name"
            raise SprayError(f"{file}: line {number}: expected: {what}")
        rows.append(row)
    if not rows or not text.endswith("\n"):
        raise SprayError(f"{file}: " + ("no parcel in it" if not rows else "is cut off"))
    table = np.array(rows)
    found = {
        name: Column(f"{file}: column {name}", table[:, place])
        for place, name in enumerate(written)
    }
    if DENSITY in names:
        diameter = found["diameter"].values
        if not np.all(diameter > 0):
            bad = int(np.argmin(diameter > 0))
            label = found["diameter"].label
            raise SprayError(f"{label}: {diameter[bad]:g} (entry {bad}) is not a size")
        density = found["mass"].values / (np.pi / 6 * diameter**3)
        found[DENSITY] = Column(f"{file}: columns mass and diameter", density)
    return found


def _opened(file: Path) -> Any:
    try:
        from pyarrow.lib import ArrowException
        from pyarrow.parquet import ParquetFile
    except ImportError as error:
        raise SprayError(
            f"{file}: reading Parquet needs pyarrow; install it with: pip install "
            '"cldit[parquet]", or save the table as CSV'
        ) from error
    try:
        # pages have checksums where the writer made them
        return ParquetFile(regular(file), page_checksum_verification=True)
    except SprayError:
        raise
    except (ArrowException, OSError) as error:
        raise SprayError(f"{file}: is damaged, or no Parquet table ({error})") from error


def parquet_names(file: Path) -> list[str]:
    """Names of the columns."""
    return [str(name) for name in _opened(file).schema_arrow.names]


def _kind(file: Path, name: str) -> Any:
    """Arrow's type of a column."""
    return _opened(file).schema_arrow.field(name).type


def parquet_columns(file: Path, names: Sequence[str]) -> dict[str, Column]:
    """Columns `names` as doubles (N,); rows without a value are marked as undefined."""
    from pyarrow.lib import ArrowException

    opened = _opened(file)
    for name in names:
        kind = opened.schema_arrow.field(name).type
        if str(kind) not in _NUMBERS:
            raise SprayError(f"{file}: column {name} is of type {kind}; expected: numbers")
    try:
        table = opened.read(columns=list(names))
    except (ArrowException, OSError) as error:
        raise SprayError(f"{file}: is damaged or truncated ({error})") from error
    found = {}
    for name in names:
        column = table.column(name)
        empty = column.is_null().to_numpy() if column.null_count else None
        values = np.asarray(column.cast("float64").to_numpy(), np.float64)
        found[name] = Column(f"{file}: column {name}", values, empty)
    return found


_NUMBERS = {"float", "double", "halffloat"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
