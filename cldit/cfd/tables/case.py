"""Tables of cells and parcels, named by a mapping file, as a CFD case."""

from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import NO_CLOUD, CfdCase, Cloud, Column, Listing, complete_cloud, stated_time
from cldit.cfd.inputs import Size, check_room
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
from cldit.cfd.names import TIME, is_mark, normalised
from cldit.cfd.one_state import check_marks
from cldit.cfd.tables.text import TextTable, dpm_columns, dpm_names
from cldit.cfd.unknown_kinds import refuse_unknown
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray


def read_tables(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads the tables that a mapping file names, relative to it.

    A cell is a box about its centre: of edges `size`, or a cube of its `volume`.
    """
    path, mapping = spec.file, names
    if mapping.cells.file is None:
        raise SprayError(f"{path}: cells.file is missing; it names the table of the gas")
    file = path.parent / mapping.cells.file
    check_room(file, _size(file))
    watch(f"reading {file.name}", 0, 1)
    source = load_table(file, mapping.cells)
    position, edges = _boxes(source, mapping.cells)
    stated_time(str(path), [] if mapping.time_s is None else [mapping.time_s], spec.time_s)
    if spec.cloud not in (None, NO_CLOUD, "parcels"):
        raise SprayError(f"{path}: no cloud {spec.cloud!r} (spray.cloud); available: parcels")
    drops = None if spec.cloud == NO_CLOUD else mapping.parcels
    cloud = None if drops is None else table_cloud(path, mapping)
    parcels = [] if drops is None or drops.file is None else [path.parent / drops.file]
    return CfdCase(
        source=str(file),
        time_s=mapping.time_s,
        mesh=BoxMesh(position.values - edges / 2, position.values + edges / 2, position.label),
        gas=gas_columns(source, mapping.cells, spec.fuel_field),
        available=tuple(source.columns),
        cloud=cloud,
        files=(path, file, *parcels),
        times_s={} if cloud is None else _times(source, cloud, parcels[0]),
    )


def _times(cells: Source, cloud: Cloud, parcels: Path) -> dict[Path, float]:
    """Times that both tables state in a column of the same name; those of a .dpm file are ages."""
    for name in cells.columns.keys() & cloud.extra.keys():
        values = [table[name].values for table in (cells.columns, cloud.extra)]
        numbers = all(column.dtype.kind in "fiu" and len(column) for column in values)
        if TIME.fullmatch(normalised(name)) and numbers and parcels.suffix != ".dpm":
            return {Path(cells.name): float(values[0][0]), parcels: float(values[1][0])}
    return {}


def list_tables(spec: CfdSpray) -> Listing:
    """Lists time [s] and columns of the tables that a mapping file names."""
    mapping = read_column_map(spec.file)
    columns = {
        name: [] if part.file is None else table_names(spec.file.parent / part.file, part)
        for name, part in (("cells", mapping.cells), ("parcels", mapping.parcels))
        if part is not None
    }
    return [] if mapping.time_s is None else [mapping.time_s], columns.pop("cells"), columns


def _size(file: Path) -> Size:
    """Estimate from the mean length of the first lines: ten columns of numbers, and boxes."""
    try:
        with open_regular(file) as stream:
            head = stream.read(1 << 16)
        rows = file.stat().st_size * head.count(b"\n") // max(len(head), 1)
    except OSError:  # the reader reports it
        rows = 0
    return Size(rows, 0, 200.0 * rows)


def _boxes(source: Source, mapping: CellColumns) -> tuple[Column, Floats]:
    """Centres and edges of the cells, (N, 3) each."""
    if mapping.position is None or (mapping.size is None) == (mapping.volume is None):
        raise SprayError(
            f"{source.name}: cells need position, and either size or volume, in the mapping file"
        )
    position = source.vector(mapping.position, "cells.position")
    if mapping.size is not None:
        size = source.vector(mapping.size, "cells.size")
    else:
        assert mapping.volume is not None
        volume = source.scalar(mapping.volume, "cells.volume")
        size = Column(volume.label, np.cbrt(volume.values)[:, None].repeat(3, axis=1))
    good = np.all((size.values > 0.0) & np.isfinite(size.values), axis=1)
    if not good.all():
        bad = int(np.argmin(good))
        raise SprayError(f"{size.label}: cell {bad} has no volume (edges {size.values[bad]} m)")
    return position, np.asarray(size.values, np.float64)


def table_cloud(path: Path, mapping: ColumnMap) -> Cloud | None:
    """Parcels of the table that the mapping file `path` names; None if it names none."""
    mapped = mapping.parcels
    if mapped is None:
        return None
    if mapped.file is None or mapped.position is None:
        raise SprayError(f"{path}: parcels.file and parcels.position are both needed")
    file = path.parent / mapped.file
    table = load_table(file, mapped)
    position = table.vector(mapped.position, "parcels.position")
    fields = cloud_columns(table, mapped)
    return complete_cloud("parcels", str(file), position, fields, table.columns, columns_of(mapped))


def table_names(file: Path, mapping: CellColumns | ParcelColumns) -> list[str]:
    """Names in the header of a table; `mapping` gives the header's line and delimiter."""
    return _header(file, mapping)[1]


def _header(file: Path, mapping: CellColumns | ParcelColumns) -> tuple[TextTable | None, list[str]]:
    """Table of text (None: of Fluent), and the names of its columns, which tell them apart."""
    if file.suffix == ".parquet":
        refuse_unknown(file)
    text = None if file.suffix == ".dpm" else TextTable(file, mapping)
    names = dpm_names(file) if text is None else text.names
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice or not any(names):
        problem = f"the column {twice[0]!r} twice" if twice else "no names of columns"
        raise SprayError(f"{file}: its header has {problem}")
    return text, names


def load_table(file: Path, mapping: CellColumns | ParcelColumns) -> Source:
    """Reads the columns that the `mapping` uses, and those that are evidence of what the rows are.

    These are columns of time or identity, and, of parcels, all that have numbers in them.
    """
    text, names = _header(file, mapping)
    mapped = columns_of(mapping)
    used = [n for n, name in enumerate(names) if {name, without_unit(name)} & mapped]
    if not used:
        raise SprayError(f"{file}: none of the mapped columns; it has: {', '.join(names)}")
    used_names = {names[place] for place in used}
    if text is None:
        evidence, read = set(names) - {"time"} - used_names, dpm_columns(file)  # `time` is an age
    else:
        numeric = text.numeric() if isinstance(mapping, ParcelColumns) else set()
        evidence = {*filter(is_mark, names), *numeric} - used_names
        read = text.columns(used, [names.index(name) for name in evidence])
    check_marks({name: read[name] for name in evidence if name in read})
    columns = {name: Column(f"{file}: column {name}", np.empty(0)) for name in names if name}
    columns |= read
    count = len(columns[names[used[0]]].values)
    if not count:
        raise SprayError(f"{file}: no row below its header")
    return Source(str(file), columns, count)
