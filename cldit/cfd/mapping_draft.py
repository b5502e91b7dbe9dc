"""Draft of a mapping file, `cldit import --write-mapping`: fields found by name, missing ones."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cldit.cfd.case import NO_CLOUD, choose_cloud
from cldit.cfd.formats import FORMATS, contents, find_format
from cldit.cfd.mapping.file import (
    PAIRS,
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Scalar,
    Vector,
    gas_names,
    merged,
    read_column_map,
    unit_in,
    units_of,
)
from cldit.cfd.names import GAS, PARCELS, VECTORS, guessed, normalised, similar
from cldit.cfd.tables.case import table_names
from cldit.errors import SprayError
from cldit.io.files import write_text
from cldit.io.plain_data import yaml_value
from cldit.scene.spray import CfdSpray

TABLES = (".csv", ".txt", ".tsv", ".dpm")
# note for the user on each key
_GAS_NOTES = {
    "temperature": "needed",
    "pressure": "needed if there is no density",
    "density": "default: that of an ideal gas at p and T",
    "fuel": "needed: mass fraction of the fuel's vapour",
}
_PARCEL_NOTES = {
    "diameter": "needed, or the radius",
    "radius": "",
    "number": "needed, or the mass of all droplets of the parcel",
    "mass": "",
    "temperature": "needed; a number is a constant",
    "density": "needed; a number is a constant, such as 684",
    "velocity": "without it spray.axis is needed",
    "age": "without it spray.nozzle_m is needed",
    "origin": "only for the penetration of OpenFOAM's log",
}
_TABLE_NOTES = {
    "position": "needed",
    "size": "needed, or the volume",
    "volume": "needed, or the size",
}
_PAIRS = {"radius": "diameter", "mass": "number", "size": "volume", "volume": "size"}


def write_mapping(spec: CfdSpray, out: Path) -> list[str]:
    """Writes the names by which a case is read to `out`; `--mapping` with it reads the same.

    A mapping that the case names is included. For a table alone, a mapping file for tables is
    drafted. Returns lines for the user: the file, and the missing names.
    """
    if out.exists():
        raise SprayError(f"{out}: exists already (--write-mapping); give another name")
    table = spec.format is None and spec.file.is_file() and spec.file.suffix.lower() in TABLES
    beside = os.path.relpath(spec.file.resolve().parent, out.resolve().parent)
    lines = _of_table(spec, beside) if table else _of_case(spec, beside)
    content = "\n".join(lines) + "\n"
    write_text(out, content)
    missing = [line.strip(" #") for line in content.splitlines() if "# not found" in line]
    return [str(out), *(f"  not found: {line.partition(':')[0]}" for line in missing)]


def _lines(
    title: str,
    mapping: ColumnMap,
    fields: Sequence[str],
    parcel_fields: Sequence[str] | None,
    beside: str,
    *,
    tables: bool,
) -> Iterator[str]:
    """Lines of a mapping file that reads as `mapping`, whose paths begin at `beside`.

    fields, parcel_fields: all names of the gas and of the parcels (None: no parcels); tables: with
    positions and sizes.
    """
    places = _TABLE_NOTES if tables else {}
    yield f"# {title}"
    yield "# Remove the # of a line to use it, and correct names and units."
    if mapping.time_s is not None:
        yield f"time_s: {mapping.time_s!r}"
    elif tables:
        yield "# time_s: 0.001"
    yield from _section("cells", mapping.cells, places | _GAS_NOTES, fields, beside)
    if parcel_fields is not None or tables:
        notes = {k: v for k, v in places.items() if k == "position"} | _PARCEL_NOTES
        parcels = mapping.parcels or ParcelColumns()
        yield from _section("parcels", parcels, notes, parcel_fields or (), beside)


def _section(
    name: str,
    mapping: CellColumns | ParcelColumns,
    notes: dict[str, str],
    available: Sequence[str],
    beside: str,
) -> Iterator[str]:
    body = []
    if mapping.file is not None:
        body.append(f"  file: {yaml_value(os.path.normpath(Path(beside, mapping.file)))}")
    for key in ("delimiter", "decimal", "header_line"):
        if key in mapping.model_fields_set and (value := getattr(mapping, key)) is not None:
            body.append(f"  {key}: {yaml_value(value)}")
    for key, note in notes.items():
        value, si = getattr(mapping, key), next(iter(units_of(key)))
        if value is not None:
            body.append(f"  {key}: {yaml_value(_plain(value, si))}")
        elif getattr(mapping, _PAIRS.get(key, key), None) is None or key not in _PAIRS:
            names = (GAS if name == "cells" else PARCELS).get(key, "")
            close = guessed(names.split(), available) or similar(key, available)
            shape = f"column: {yaml_value(close[0]) if close else 'NAME'}"
            if key in ("position", "size", "velocity", "origin"):
                shape = "columns: [X, Y, Z]"
            line = f"  # {key}: {{{shape}, unit: {yaml_value(si)}}}  # not found"
            body.append(line + (f"; {note}" if note else ""))
    active = any(not line.lstrip().startswith("#") for line in body)
    yield f"{name}:" if active else f"# {name}:"
    yield f"  # available: {', '.join(sorted(available)) or 'none'}"
    yield from body


def _plain(value: Any, si: str) -> Any:
    """Column with its unit, in the shortest form that reads the same."""
    if isinstance(value, Scalar) and value.value is not None:
        return value.value if value.unit is None else {"value": value.value, "unit": value.unit}
    names = list(value.columns) if isinstance(value, Vector) else [str(value.column)]
    plain: dict[str, Any] = (
        {"columns": names} if isinstance(value, Vector) else {"column": names[0]}
    )
    if value.unit is not None:
        plain["unit"] = value.unit
    elif not any(unit_in(name) for name in names):
        plain["unit"] = si
    if getattr(value, "undefined", None) is not None:
        plain["undefined"] = value.undefined
    return plain


def _of_case(spec: CfdSpray, beside: str) -> Iterator[str]:
    """Draft of a mapping for a case, from the names by which it is read."""
    kind = find_format(spec)
    if kind == "cldit":
        raise SprayError(f"{spec.file}: cldit's own file needs no mapping")
    listing = contents(spec)
    if kind == "tables":
        mapping = read_column_map(spec.file)
        parcels = None if mapping.parcels is None else listing.clouds.get("parcels", ())
    else:
        clouds = listing.clouds if spec.cloud != NO_CLOUD else {}
        chosen = choose_cloud(str(spec.file), clouds, spec.cloud)
        parcels = None if chosen is None else clouds[chosen]
        override = ColumnMap() if spec.mapping is None else read_column_map(spec.mapping)
        fields = {field.rpartition("/")[2] for field in listing.fields}  # without the region
        form = FORMATS[kind]
        mapping = ColumnMap(cells=gas_names(override.cells, fields, spec.fuel_field, form.gas))
        if parcels is not None:
            names = form.parcels(
                [*parcels, *(f"{name}_{part}" for name in parcels for part in "XYZ")]
            )
            mapping = mapping.model_copy(update={"parcels": merged(override.parcels, names)})
    title = f"Names of {spec.file} ({kind}) for `cldit import --mapping`"
    return _lines(title, mapping, listing.fields, parcels, beside, tables=kind == "tables")


def _of_table(spec: CfdSpray, beside: str) -> Iterator[str]:
    """Draft of a mapping for tables, from the names of one table."""
    file = spec.file.resolve()
    names, place = table_names(file, CellColumns()), Path(file.name)
    fuel_name = normalised(spec.fuel_field)
    mass_fraction = "{0} y{0} massfractionof{0} massfrac{0} {0}massfraction"
    mole_fraction = "molefractionof{0} {0}molefraction molef{0} x{0}"
    fuel = f"{mass_fraction} {GAS['fuel']} {mole_fraction}".format(fuel_name)

    def scalars(aliases: Mapping[str, str]) -> dict[str, Any]:
        matches = {key: guessed(several.split(), names) for key, several in aliases.items()}
        return {key: Scalar(column=hits[0]) for key, hits in matches.items() if len(hits) == 1}

    def vector(key: str) -> Vector | None:
        for letters in VECTORS[key].split(", "):
            parts = [guessed([letter], names) for letter in letters.split()]
            if all(len(part) == 1 for part in parts):
                return Vector(columns=(parts[0][0], parts[1][0], parts[2][0]))
        return None

    title = f"Names of {file.name} for `cldit import` of this file; check the guesses"
    parcels = scalars(PARCELS)
    if {"diameter", "radius"} & set(parcels):
        parcels |= {"position": vector("position"), "velocity": vector("velocity")}
        for key, alternative in PAIRS:
            if key in parcels:
                parcels.pop(alternative, None)
        mapping = ColumnMap(parcels=ParcelColumns(file=place, **parcels))
        return _lines(title, mapping, [], names, beside, tables=True)
    cells = scalars({**GAS, "fuel": fuel})
    cells |= {"position": vector("position"), "size": vector("size")}
    if cells["size"] is not None:
        cells.pop("volume", None)
    mapping = ColumnMap(cells=CellColumns(file=place, **cells))
    return _lines(title, mapping, names, [], beside, tables=True)
