"""Tables of cells and parcels as text, for codes whose own files are not read."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from cldit.cfd.case import CfdCase, Cloud, Column, complete_cloud, nearest_time
from cldit.cfd.column_mapping import (
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Source,
    cloud_columns,
    gas_columns,
    read_column_map,
)
from cldit.cfd.element_mesh import BoxMesh
from cldit.cfd.size import Size, check_room
from cldit.errors import SprayError
from cldit.spray.result import Floats


def read_tables(path: Path, *, time_s: float | None, fuel_field: str) -> CfdCase:
    """Reads the tables that a mapping file names, relative to it.

    A cell is a box about its centre: of edges `size`, or a cube of its `volume`.

    Args:
        path: the mapping file.
        time_s: must be that of the mapping; None takes it.
        fuel_field: name of the fuel's mass fraction.

    Raises:
        SprayError: the mapping or a table is missing or damaged, lacks a column, a cell has no
            volume, or the table does not fit into memory.
    """
    mapping = read_column_map(path)
    if mapping.cells.file is None:
        raise SprayError(f"{path}: cells.file is missing; it names the table of the gas")
    file = path.parent / mapping.cells.file
    check_room(file, _size(file))
    source = load_table(file, mapping.cells)
    position, edges = _boxes(source, mapping.cells)
    if mapping.time_s is not None:
        nearest_time(str(path), [mapping.time_s], time_s)
    elif time_s is not None:
        raise SprayError(f"{path}: does not say its time (time_s); leave spray.time_s out")
    return CfdCase(
        source=str(file),
        time_s=mapping.time_s,
        mesh=BoxMesh(position.values - edges / 2, position.values + edges / 2, position.label),
        gas=gas_columns(source, mapping.cells, fuel_field),
        available=tuple(source.columns),
        cloud=_cloud(path, mapping),
    )


def _size(file: Path) -> Size:
    """By the mean length of the first lines; ten columns of numbers, and again as boxes."""
    try:
        with file.open("rb") as stream:
            head = stream.read(1 << 16)
        rows = file.stat().st_size * head.count(b"\n") // max(len(head), 1)
    except OSError:  # who reads the file says what is wrong with it
        rows = 0
    return Size(rows, 0, 200.0 * rows)


def _boxes(source: Source, wanted: CellColumns) -> tuple[Column, Floats]:
    """Centres and edges of the cells, (N, 3) both."""
    if wanted.position is None or (wanted.size is None) == (wanted.volume is None):
        raise SprayError(
            f"{source.name}: cells need position, and either size or volume, in the mapping file"
        )
    position = source.vector(wanted.position, "length", "cells.position")
    if wanted.size is not None:
        size = source.vector(wanted.size, "length", "cells.size")
    else:
        assert wanted.volume is not None
        volume = source.scalar(wanted.volume, "volume", "cells.volume")
        size = Column(volume.label, np.cbrt(volume.values)[:, None].repeat(3, axis=1))
    good = np.all((size.values > 0.0) & np.isfinite(size.values), axis=1)
    if not good.all():
        bad = int(np.argmin(good))
        raise SprayError(f"{size.label}: cell {bad} has no volume (edges {size.values[bad]} m)")
    return position, np.asarray(size.values, np.float64)


def _cloud(path: Path, mapping: ColumnMap) -> Cloud | None:
    wanted = mapping.parcels
    if wanted is None:
        return None
    if wanted.file is None or wanted.position is None:
        raise SprayError(f"{path}: parcels.file and parcels.position are both needed")
    file = path.parent / wanted.file
    source = load_table(file, wanted)
    position = source.vector(wanted.position, "length", "parcels.position")
    return complete_cloud("parcels", str(file), position, cloud_columns(source, wanted))


def table_names(file: Path, wanted: CellColumns | ParcelColumns) -> list[str]:
    """The names in the header of a table, as `wanted` says where it is in `file`.

    Raises:
        SprayError: the file cannot be read, or names a column twice.
    """
    try:
        with file.open(encoding="utf-8-sig") as stream:
            lines = [stream.readline() for _ in range(wanted.header_line)]
    except (OSError, UnicodeDecodeError) as error:
        raise SprayError(f"{file}: cannot be read ({error})") from error
    header = lines[-1].strip().lstrip("#")
    parts = header.split() if wanted.delimiter == " " else header.split(wanted.delimiter)
    names = [part.strip().strip('"').strip() for part in parts]
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice or not any(names):
        what = f"the column {twice[0]!r} twice" if twice else "no names of columns"
        raise SprayError(f"{file}: line {wanted.header_line} holds {what}")
    return names


def load_table(file: Path, wanted: CellColumns | ParcelColumns) -> Source:
    """The columns of the table `file` that the mapping `wanted` uses; the others are named only.

    Raises:
        SprayError: the file cannot be read, is cut off, or holds text where a number is expected.
    """
    names = table_names(file, wanted)
    used: set[str] = set()
    for key in type(wanted).model_fields:
        value = getattr(wanted, key)
        used |= {getattr(value, "column", None) or ""} | set(getattr(value, "columns", ()))
    use = [place for place, name in enumerate(names) if name in used]
    with file.open("rb") as stream:
        stream.seek(0, 2)
        stream.seek(max(stream.tell() - 1, 0))
        if stream.read() not in (b"\n", b"\r"):
            raise SprayError(f"{file}: its last line has no end: the file is cut off")
    if not use:
        raise SprayError(f"{file}: none of the mapped columns; it has: {', '.join(names)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that there is no row: said below
            rows = np.loadtxt(
                file,
                delimiter=None if wanted.delimiter == " " else wanted.delimiter,
                skiprows=wanted.header_line,
                usecols=use,
                ndmin=2,
                encoding="utf-8-sig",
            )
    except (ValueError, OSError) as error:
        shown = ", ".join(names[place] for place in use)
        raise SprayError(f"{file}: its columns {shown} are not all numbers ({error})") from error
    if not len(rows):
        raise SprayError(f"{file}: holds no row below its header")
    columns = {name: Column(f"{file}: column {name}", np.empty(0)) for name in names if name}
    for place, index in enumerate(use):
        columns[names[index]] = Column(f"{file}: column {names[index]}", rows[:, place])
    return Source(str(file), columns, len(rows))
