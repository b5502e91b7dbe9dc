"""The names by which a case is read, as a mapping file to edit: `cldit import --write-mapping`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cldit.cfd import converge, fluent, text_tables
from cldit.cfd.case import NO_CLOUD, choose_cloud
from cldit.cfd.formats import contents, find_format
from cldit.cfd.known_names import GAS_NAMES, PARCEL_KEYS, guessed, guessed_vector, normalised
from cldit.cfd.mapping_draft import mapping_text
from cldit.cfd.mapping_file import (
    CGNS_NAMES,
    FOAM_NAMES,
    PARCEL_NAMES,
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Scalar,
    Vector,
    columns_of_value,
    gas_names,
    merged,
    read_column_map,
)
from cldit.errors import SprayError
from cldit.io.files import write_text
from cldit.scene.spray import CfdSpray

TABLES = (".csv", ".txt", ".tsv", ".parquet", ".dpm")


def write_mapping(spec: CfdSpray, out: Path) -> list[str]:
    """Writes the names by which a case is read; `--mapping` with it reads the same.

    Of a table alone, a mapping file for tables is begun, with the names that are known.

    Args:
        spec: the case, or a table; a mapping that it names is taken over.
        out: the file, which must not be there.

    Returns:
        Lines for the user: the file, and what is missing in it.

    Raises:
        SprayError: the case cannot be listed, is cldit's own file, or `out` is there.
        DiskFull, FileError: the file cannot be written.
    """
    if out.exists():
        raise SprayError(f"{out}: is there already (--write-mapping); give another name")
    folder = out.resolve().parent
    if spec.format is None and spec.file.is_file() and spec.file.suffix.lower() in TABLES:
        text = _of_table(spec, folder)
    else:
        text = _of_case(spec, folder)
    write_text(out, text)
    missing = [line.strip(" #") for line in text.splitlines() if "# not found" in line]
    return [str(out), *(f"  not found: {line.partition(':')[0]}" for line in missing)]


def _of_case(spec: CfdSpray, folder: Path) -> str:
    kind = find_format(spec)
    if kind == "cldit":
        raise SprayError(f"{spec.file}: is cldit's own file, whose names need no mapping")
    known = contents(spec)
    if kind == "tables":
        found, parcels = _absolute(read_column_map(spec.file), spec.file.resolve().parent), None
        if found.parcels is not None:
            parcels = known.clouds.get("parcels", ())
    else:
        clouds = known.clouds if spec.cloud != NO_CLOUD else {}
        chosen = choose_cloud(str(spec.file), clouds, spec.cloud)
        parcels = None if chosen is None else clouds[chosen]
        given = ColumnMap() if spec.mapping is None else read_column_map(spec.mapping)
        found = _found(kind, given, known.fields, parcels, spec.fuel_field)
    return mapping_text(
        f"Names of {spec.file} ({kind}) for `cldit import --mapping`",
        found,
        fields=known.fields,
        parcel_fields=parcels,
        folder=folder,
        tables=kind == "tables",
    )


def _found(
    kind: str,
    given: ColumnMap,
    fields: Sequence[str],
    parcels: Sequence[str] | None,
    fuel_field: str,
) -> ColumnMap:
    """The format's own names that there are, with what a mapping gives in their place."""
    if kind == "converge":
        cells = converge.gas_names(fields, given.cells, fuel_field)
    elif kind == "fluent":
        cells = fluent.fluent_names(list(fields), given.cells, fuel_field)
    else:
        # fields of a region are listed by its name and theirs
        known = {each.rpartition("/")[2] for each in fields}
        names = CGNS_NAMES if kind == "cgns" else FOAM_NAMES
        cells = gas_names(given.cells, known, fuel_field, names)
    if parcels is None:
        return ColumnMap(cells=cells)
    if kind == "converge":
        return ColumnMap(cells=cells, parcels=merged(given.parcels, converge.parcel_names(parcels)))
    parts = {*parcels, *(f"{name}_{letter}" for name in parcels for letter in "XYZ")}
    absent = {
        key: None
        for key, value in PARCEL_NAMES
        if isinstance(value, (Scalar, Vector)) and not columns_of_value(value) <= parts
    }
    default = PARCEL_NAMES.model_copy(update=absent)
    return ColumnMap(cells=cells, parcels=merged(given.parcels, default))


def _absolute(found: ColumnMap, folder: Path) -> ColumnMap:
    """The mapping with its tables' files by their whole path."""

    def placed(part: Any) -> Any:
        if part is None or part.file is None:
            return part
        return part.model_copy(update={"file": folder / part.file})

    update = {"cells": placed(found.cells), "parcels": placed(found.parcels)}
    return found.model_copy(update=update)


def _of_table(spec: CfdSpray, folder: Path) -> str:
    """A mapping for tables, begun from the names of one."""
    file = spec.file.resolve()
    names = text_tables.table_names(file, CellColumns())
    own = normalised(spec.fuel_field)
    begins = ("", "y", "massfractionof", "massfrac")
    fuel = (*(f"{begin}{own}" for begin in begins), *GAS_NAMES["fuel"])

    def scalars(known: dict[str, tuple[str, ...]]) -> dict[str, Any]:
        found = {key: guessed(several, names) for key, several in known.items()}
        return {key: Scalar(column=each[0]) for key, each in found.items() if len(each) == 1}

    def vector(key: str) -> Vector | None:
        columns = guessed_vector(key, names)
        return None if columns is None else Vector(columns=columns)

    parcels = scalars(PARCEL_KEYS)
    if {"diameter", "radius"} & set(parcels):
        parcels |= {"position": vector("position"), "velocity": vector("velocity")}
        for one, other in (("diameter", "radius"), ("number", "mass")):
            if one in parcels:
                parcels.pop(other, None)
        found = ColumnMap(parcels=ParcelColumns(file=file, **parcels))
        fields, drops = [], names
    else:
        cells = scalars({**GAS_NAMES, "fuel": fuel})
        cells |= {"position": vector("position"), "size": vector("size")}
        if cells["size"] is not None:
            cells.pop("volume", None)
        found = ColumnMap(cells=CellColumns(file=file, **cells))
        fields, drops = names, []
    return mapping_text(
        f"Names of {file.name} for `cldit import` of this file; what is guessed is to be checked",
        found,
        fields=fields,
        parcel_fields=drops,
        folder=folder,
        tables=True,
    )
