"""Draft of a mapping file, `cldit import --write-mapping`: fields found by name, missing ones."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cldit.cfd.assumed import similar
from cldit.cfd.case import NO_CLOUD, choose_cloud
from cldit.cfd.formats import contents, find_format
from cldit.cfd.hdf.cgns import CGNS_NAMES
from cldit.cfd.hdf.converge import CONVERGE_NAMES, parcel_names
from cldit.cfd.hdf.fluent import FLUENT_NAMES
from cldit.cfd.mapping.file import (
    FOAM_NAMES,
    PARCEL_NAMES,
    UNITS,
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Scalar,
    Table,
    Vector,
    columns_of_value,
    gas_names,
    merged,
    read_column_map,
    unit_in,
    without_unit,
)
from cldit.cfd.tables import table_names
from cldit.errors import SprayError
from cldit.io.files import write_text
from cldit.io.plain_data import yaml_line
from cldit.scene.spray import CfdSpray

# key: kind of its unit, and a note for the user
_GAS_LINES = {
    "temperature": ("temperature", "needed"),
    "pressure": ("pressure", "needed if there is no density"),
    "density": ("density", "default: that of an ideal gas at p and T"),
    "fuel": ("fraction", "needed: mass fraction of the fuel's vapour"),
}
_PARCEL_LINES = {
    "diameter": ("length", "needed, or the radius"),
    "radius": ("length", ""),
    "number": ("count", "needed, or the mass of all droplets of the parcel"),
    "mass": ("mass", ""),
    "temperature": ("temperature", "needed; a number is a constant"),
    "density": ("density", "needed; a number is a constant, such as 684"),
    "velocity": ("velocity", "without it spray.axis is needed"),
    "age": ("time", "without it spray.nozzle_m is needed"),
    "origin": ("length", "only for the penetration of OpenFOAM's log"),
}
_PLACE_LINES = {
    "position": ("length", "needed"),
    "size": ("length", "needed, or the volume"),
    "volume": ("volume", "needed, or the size"),
}
_PAIRS = {"radius": "diameter", "mass": "number", "size": "volume", "volume": "size"}


def mapping_text(
    title: str,
    found: ColumnMap,
    *,
    fields: Iterable[str],
    parcel_fields: Iterable[str] | None,
    folder: Path,
    tables: bool = False,
) -> str:
    """Text of a mapping file that reads as `found`, with comments on missing and available names.

    `title`: first line; `parcel_fields` None: no parcels; `folder`: paths of tables are relative to
    it; `tables`: include positions and sizes.
    """
    places = _PLACE_LINES if tables else {}
    lines = [
        f"# {title}",
        "# Remove the # of a line to use it, and correct names and units.",
    ]
    if found.time_s is not None:
        lines.append(f"time_s: {found.time_s!r}")
    elif tables:
        lines.append("# time_s: 0.001")
    lines += _section("cells", found.cells, places | _GAS_LINES, list(fields), folder)
    if parcel_fields is not None or tables:
        given = found.parcels or ParcelColumns()
        some = {k: v for k, v in places.items() if k == "position"} | _PARCEL_LINES
        lines += _section("parcels", given, some, list(parcel_fields or ()), folder)
    return "\n".join(lines) + "\n"


def _section(
    name: str,
    given: CellColumns | ParcelColumns,
    keys: dict[str, tuple[str, str]],
    known: list[str],
    folder: Path,
) -> Iterator[str]:
    body = [*_table(given, folder)]
    for key, (kind, note) in keys.items():
        value = getattr(given, key)
        if value is not None:
            body.append(f"  {key}: {_word(_plain(value, kind))}")
        elif getattr(given, _PAIRS.get(key, key), None) is None or key not in _PAIRS:
            body.append(_missing(name, key, kind, note, known))
    active = any(not line.lstrip().startswith("#") for line in body)
    yield f"{name}:" if active else f"# {name}:"
    yield f"  # available: {', '.join(sorted(known)) or 'none'}"
    yield from body


def _table(given: Table, folder: Path) -> Iterator[str]:
    if given.file is not None:
        yield f"  file: {_word(os.path.relpath(given.file, folder))}"
    for key in ("delimiter", "decimal", "header_line"):
        if key in given.model_fields_set and (value := getattr(given, key)) is not None:
            yield f"  {key}: {_word(value)}"


def _missing(part: str, key: str, kind: str, note: str, known: list[str]) -> str:
    """Comment line for a missing quantity, with the likeliest names."""
    names = GAS_NAMES if part == "cells" else PARCEL_KEYS
    close = guessed(names.get(key, ()), known) or similar(key, known)
    unit = next(iter(UNITS[kind]))
    likely = _word(close[0]) if close else "NAME"
    shape = f"{{column: {likely}, unit: {unit}}}"
    if key in ("position", "size", "velocity", "origin"):
        shape = f"{{columns: [X, Y, Z], unit: {unit}}}"
    return f"  # {key}: {shape}  # not found" + (f"; {note}" if note else "")


def _plain(value: Any, kind: str) -> Any:
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
        plain["unit"] = next(iter(UNITS[kind]))
    if getattr(value, "undefined", None) is not None:
        plain["undefined"] = value.undefined
    return plain


def _word(value: Any) -> str:
    return yaml_line([value])[1:-1]


TABLES = (".csv", ".txt", ".tsv", ".parquet", ".dpm")


def write_mapping(spec: CfdSpray, out: Path) -> list[str]:
    """Writes the names by which a case is read to `out`; `--mapping` with it reads the same.

    A mapping that the case names is taken over. For a table alone, a mapping file for tables is
    drafted. Returns lines for the user: the file, and the missing names.
    """
    if out.exists():
        raise SprayError(f"{out}: exists already (--write-mapping); give another name")
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
        raise SprayError(f"{spec.file}: cldit's own file needs no mapping")
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


_NAMES: dict[str, Mapping[str, tuple[str, ...]]] = {
    "cgns": CGNS_NAMES,
    "converge": CONVERGE_NAMES,
    "fluent": FLUENT_NAMES,
}


def _found(
    kind: str,
    given: ColumnMap,
    fields: Sequence[str],
    parcels: Sequence[str] | None,
    fuel_field: str,
) -> ColumnMap:
    """Format's own names that are present, overridden by those of a mapping."""
    known = {each.rpartition("/")[2] for each in fields}  # without the region
    cells = gas_names(given.cells, known, fuel_field, _NAMES.get(kind, FOAM_NAMES))
    if parcels is None:
        return ColumnMap(cells=cells)
    if kind == "converge":
        return ColumnMap(cells=cells, parcels=merged(given.parcels, parcel_names(parcels)))
    parts = {*parcels, *(f"{name}_{letter}" for name in parcels for letter in "XYZ")}
    absent = {
        key: None
        for key, value in PARCEL_NAMES
        if isinstance(value, (Scalar, Vector)) and not columns_of_value(value) <= parts
    }
    default = PARCEL_NAMES.model_copy(update=absent)
    return ColumnMap(cells=cells, parcels=merged(given.parcels, default))


def _absolute(found: ColumnMap, folder: Path) -> ColumnMap:
    """Mapping with absolute paths of its tables."""

    def placed(part: Any) -> Any:
        if part is None or part.file is None:
            return part
        return part.model_copy(update={"file": folder / part.file})

    update = {"cells": placed(found.cells), "parcels": placed(found.parcels)}
    return found.model_copy(update=update)


def _of_table(spec: CfdSpray, folder: Path) -> str:
    """Draft of a mapping for tables, from the names of one table."""
    file = spec.file.resolve()
    names = table_names(file, CellColumns())
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
        f"Names of {file.name} for `cldit import` of this file; check the guesses",
        found,
        fields=fields,
        parcel_fields=drops,
        folder=folder,
        tables=True,
    )


# Normalised: lower case, letters and digits alone, without the unit.
GAS_NAMES: dict[str, tuple[str, ...]] = {
    "temperature": ("t", "temp", "temperature", "statictemperature", "gastemperature", "svt"),
    "pressure": ("p", "pres", "absolutepressure", "absolutestaticpressure", "pressure"),
    "density": ("rho", "dens", "density", "svdensity"),
    "fuel": ("fuel", "yfuel", "massfractionoffuel", "fuelmassfraction", "massfractionfuel"),
    "volume": ("v", "vol", "volume", "cellvolume"),
}
PARCEL_KEYS: dict[str, tuple[str, ...]] = {
    "diameter": ("d", "diam", "diameter", "particlediameter", "dropletdiameter"),
    "radius": ("r", "rad", "radius", "particleradius", "parcelradius"),
    "number": (
        *("nparticle", "n", "num", "number", "numdrop", "ninparcel", "particlecount"),
        *("parcelparticlecount", "numberofdroplets", "particlesperparcel", "numberinparcel"),
    ),
    "mass": ("parcelmass",),
    "temperature": ("t", "temp", "temperature", "particletemperature", "parceltemp"),
    "density": ("rho", "dens", "density", "particledensity"),
    "age": ("age", "residencetime", "particleresidencetime", "lifetime", "parcelage"),
}
VECTORS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "position": (
        ("x", "y", "z"),
        ("xposition", "yposition", "zposition"),
        ("xcoordinate", "ycoordinate", "zcoordinate"),
        ("centroidx", "centroidy", "centroidz"),
        ("points0", "points1", "points2"),
    ),
    "size": (("dx", "dy", "dz"),),
    "velocity": (
        ("u", "v", "w"),
        ("ux", "uy", "uz"),
        ("u0", "u1", "u2"),
        ("velocityi", "velocityj", "velocityk"),
        ("velocity0", "velocity1", "velocity2"),
        ("velocityx", "velocityy", "velocityz"),
        ("xvelocity", "yvelocity", "zvelocity"),
    ),
}


def normalised(name: str) -> str:
    """Letters and digits of a name without its unit: `velocityi` of `Velocity[i] (m/s)`."""
    return re.sub(r"[^a-z0-9]", "", without_unit(name).lower())


def guessed(known: Iterable[str], names: Iterable[str]) -> list[str]:
    """Selects the `names` that some program gives to a quantity, the likeliest first."""
    by_name: dict[str, list[str]] = {}
    for each in names:
        by_name.setdefault(normalised(each), []).append(each)
    return [each for name in known for each in by_name.get(name, ())]


def guessed_vector(key: str, names: Iterable[str]) -> tuple[str, str, str] | None:
    """Three columns that some program gives to the vector `key`; None if there are none."""
    listed = list(names)
    for letters in VECTORS[key]:
        parts = [guessed((letter,), listed) for letter in letters]
        if all(len(part) == 1 for part in parts):
            return parts[0][0], parts[1][0], parts[2][0]
    return None
