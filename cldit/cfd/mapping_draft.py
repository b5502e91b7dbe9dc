"""A mapping file to edit: what of a case was found by its name, and what is missing."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from cldit.cfd.assumed import similar
from cldit.cfd.known_names import GAS_NAMES, PARCEL_KEYS, guessed
from cldit.cfd.mapping_file import (
    UNITS,
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Scalar,
    Table,
    Vector,
    unit_in,
)
from cldit.io.plain_data import yaml_line

# key: kind of its unit, whether a droplet needs it, and what else may be said
_GAS_LINES = {
    "temperature": ("temperature", "needed"),
    "pressure": ("pressure", "needed where there is no density"),
    "density": ("density", "without it that of an ideal gas at p and T is taken"),
    "fuel": ("fraction", "needed: mass fraction of the fuel's vapour"),
}
_PARCEL_LINES = {
    "diameter": ("length", "needed, or the radius"),
    "radius": ("length", ""),
    "number": ("count", "needed, or the mass of all droplets of the parcel"),
    "mass": ("mass", ""),
    "temperature": ("temperature", "needed; a number is a constant"),
    "density": ("density", "needed; a number is a constant, as 684"),
    "velocity": ("velocity", "without it spray.axis is to be given"),
    "age": ("time", "without it spray.nozzle_m is to be given"),
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
    """The text of a mapping file that reads as `found`.

    Args:
        title: what the case is, for the first line.
        found: names that were found.
        fields: all names of the gas.
        parcel_fields: all names of the parcels; None: there are no parcels.
        folder: in which the file will lie; paths of tables are relative to it.
        tables: whether positions and sizes belong to it.

    Returns:
        YAML, with comments on what is missing and which names there are.
    """
    places = _PLACE_LINES if tables else {}
    lines = [
        f"# {title}",
        "# Take the # away from a line to use it, and correct names and units.",
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
    yield f"  # there are: {', '.join(sorted(known)) or 'none'}"
    yield from body


def _table(given: Table, folder: Path) -> Iterator[str]:
    if given.file is not None:
        yield f"  file: {_word(os.path.relpath(given.file, folder))}"
    for key in ("delimiter", "decimal", "header_line"):
        if key in given.model_fields_set and (value := getattr(given, key)) is not None:
            yield f"  {key}: {_word(value)}"


def _missing(part: str, key: str, kind: str, note: str, known: list[str]) -> str:
    """A line of what was not found, with the likeliest names."""
    names = GAS_NAMES if part == "cells" else PARCEL_KEYS
    close = guessed(names.get(key, ()), known) or similar(key, known)
    unit = next(iter(UNITS[kind]))
    likely = _word(close[0]) if close else "NAME"
    shape = f"{{column: {likely}, unit: {unit}}}"
    if key in ("position", "size", "velocity", "origin"):
        shape = f"{{columns: [X, Y, Z], unit: {unit}}}"
    return f"  # {key}: {shape}  # not found" + (f"; {note}" if note else "")


def _plain(value: Any, kind: str) -> Any:
    """A column with its unit, in the shortest form that reads as the same."""
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
