"""Mapping files: quantity, column and unit of each field of a CFD result."""

import re
from collections.abc import Collection, Container, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from cldit.constants import ZERO_CELSIUS_K, STANDARD_ATMOSPHERE_Pa
from cldit.errors import SprayError
from cldit.io.plain_data import read_mapping
from cldit.scene.checks import Section, describe
from cldit.scene.spray import Check

# unit: factor and offset to SI, value * factor + offset
_PLAIN = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "volume": {"m3": 1.0, "l": 1e-3, "cm3": 1e-6, "mm3": 1e-9},
    "pressure": {
        "Pa": 1,
        "kPa": 1e3,
        "MPa": 1e6,
        "bar": 1e5,
        "atm": STANDARD_ATMOSPHERE_Pa,
        "Pa absolute": 1,
    },
    "density": {"kg/m3": 1.0, "g/cm3": 1e3, "g/l": 1.0},
    "fraction": {"1": 1.0, "%": 1e-2, "mol/mol": 1.0},
    "count": {"1": 1.0},
    "mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "ug": 1e-9},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
}
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    kind: {unit: (factor, 0.0) for unit, factor in units.items()} for kind, units in _PLAIN.items()
} | {
    "temperature": {"K": (1.0, 0.0), "degC": (1.0, ZERO_CELSIUS_K), "degF": (5 / 9, 459.67 * 5 / 9)}
}


# by the powers of kg, m, s, K, and one that is 0 (OpenFOAM: kmol, CGNS: degree)
SI_UNITS: dict[tuple[float, ...], str] = {
    (0, 0, 0, 0, 0): "1",
    (0, 0, 0, 1, 0): "K",
    (1, -1, -2, 0, 0): "Pa",
    (1, -3, 0, 0, 0): "kg/m3",
}
# kind of the unit of each key; that of another key is the key itself
_KINDS = {"fuel": "fraction", "number": "count", "age": "time"} | dict.fromkeys(
    ("position", "size", "diameter", "radius", "origin"), "length"
)


def units_of(key: str) -> dict[str, tuple[float, float]]:
    """Units that a key of a mapping file may have, SI first: factor and offset to SI."""
    return UNITS[_KINDS.get(key, key)]


_UNIT = re.compile(r"\s*[\[(]([^\])]*)[\])]$")  # at the end of a column's name
# no unit: a component of a vector, as STAR-CCM+ has it, or a species, as AMReX has it
_COMPONENT = re.compile(r"\[[ijkxyzIJKXYZ0-2]\]$|^[XY]\([A-Z-]+\d[A-Z\d-]*\)$")
_SPELLED = (
    {"-": "1", "": "1", "C": "degC", "°C": "degC", "F": "degF", "°F": "degF"}
    | {"m^3": "m3", "mm^3": "mm3", "cm^3": "cm3", "m³": "m3", "mm³": "mm3", "cm³": "cm3"}
    | {"kg/m^3": "kg/m3", "kg/m³": "kg/m3", "g/cm^3": "g/cm3", "g/cm³": "g/cm3"}
    | {"kg m^-3": "kg/m3", "m s^-1": "m/s", "µm": "um", "μm": "um", "micron": "um", "microns": "um"}
)


def without_unit(name: str) -> str:
    """Column's name without the unit at its end: `T` of `T [K]`."""
    return name if _COMPONENT.search(name) else _UNIT.sub("", name)


def unit_in(name: str) -> str | None:
    """Unit at the end of a column's name, as `UNITS` spells it; None if there is none."""
    match = None if _COMPONENT.search(name) else _UNIT.search(name)
    return None if match is None else spelled(match[1])


def spelled(unit: str) -> str:
    """Unit as `UNITS` spells it."""
    return _SPELLED.get(unit.strip(), unit.strip())


# name of a column: unit of what it is, if no other is stated; the last is none that is read
_QUANTITIES = {
    "fuel": (
        (re.compile(r"mol(ar|e|es)?[ _.-]?f|volume[ _.-]?f|^x[ _.-]", re.IGNORECASE), "mol/mol"),
        (re.compile(r"concentration|partial", re.IGNORECASE), "concentration or partial pressure"),
    ),
    "pressure": (
        (re.compile(r"abs", re.IGNORECASE), "Pa absolute"),
        (re.compile(r"gau?ge|relative", re.IGNORECASE), "Pa gauge"),
    ),
}


def quantity_in(name: str, key: str) -> str | None:
    """Unit of the quantity that a column's name states: mol/mol of `Mole Fraction of C7H16`."""
    return next((unit for form, unit in _QUANTITIES.get(key, ()) if form.search(name)), None)


class Scalar(Section):
    """Column by name, or a constant `value`; `unit` defaults to SI.

    undefined: replaces values that the file marks as undefined, in the same unit.
    """

    column: str | None = None
    value: float | None = None
    unit: str | None = None
    undefined: float | None = None

    @model_validator(mode="after")
    def _column_or_value(self) -> "Scalar":
        if (self.column is None) == (self.value is None):
            raise ValueError("needs either column or value")
        return self


class Vector(Section):
    """Three columns by name; `unit` defaults to SI."""

    columns: tuple[str, str, str]
    unit: str | None = None


def _short_scalar(value: object) -> object:
    if isinstance(value, str):
        return {"column": value}
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return {"value": value}
    return value


def _short_vector(value: object) -> object:
    if isinstance(value, str):  # the name of a vector
        return {"columns": [f"{value}_{letter}" for letter in "XYZ"]}
    return {"columns": value} if isinstance(value, (list, tuple)) else value


A = Annotated[Scalar | None, BeforeValidator(_short_scalar)]
V = Annotated[Vector | None, BeforeValidator(_short_vector)]


class Table(Section):
    """Path and layout of a table; only for `format: tables`.

    delimiter: by default taken from the header; a space is any white space. decimal: decimal mark.
    """

    file: Path | None = None
    delimiter: str | None = Field(None, min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    header_line: int = Field(1, ge=1, le=1000)


class CellColumns(Table):
    """Columns of the gas; `position` and `size` or `volume` only for tables."""

    position: V = None
    size: V = None
    volume: A = None
    temperature: A = None
    pressure: A = None
    density: A = None
    fuel: A = None


PAIRS = (("diameter", "radius"), ("number", "mass"))  # one replaces the other


class ParcelColumns(Table):
    """Columns of the parcels; `position` only for tables.

    mass: of all droplets of the parcel. origin: birthplace of the parcel.
    """

    position: V = None
    velocity: V = None
    diameter: A = None
    radius: A = None
    number: A = None
    mass: A = None
    temperature: A = None
    density: A = None
    age: A = None
    origin: V = None

    @model_validator(mode="after")
    def _no_pair(self) -> "ParcelColumns":
        for key, alternative in PAIRS:
            if getattr(self, key) is not None and getattr(self, alternative) is not None:
                raise ValueError(f"{key} and {alternative} are both given; allowed: one of them")
        return self

    def among(self, columns: Collection[str]) -> "ParcelColumns":
        """Restricts the quantities to those with all their columns in `columns`."""
        absent = {key: None for key, value in self if not columns_of_value(value) <= set(columns)}
        return self.model_copy(update=absent)


class ColumnMap(Section):
    """Whole mapping file. accept: as `spray.accept`."""

    time_s: float | None = None
    accept: tuple[Check, ...] = ()
    cells: CellColumns = CellColumns()
    parcels: ParcelColumns | None = None


def read_column_map(path: Path) -> ColumnMap:
    """Reads a mapping file."""
    try:
        return ColumnMap.model_validate(read_mapping(path))
    except ValidationError as error:
        raise SprayError(f"{path}: {describe(ColumnMap, error.errors())}") from error
    except ValueError as error:  # of read_mapping, which names the file
        raise SprayError(str(error)) from error


S = TypeVar("S", CellColumns, ParcelColumns)


def merged(mapping: S | None, default: S) -> S:
    """Overrides `default` by the keys set in `mapping`; a diameter drops the radius, and so on."""
    if mapping is None:
        return default
    chosen = {name: getattr(mapping, name) for name in mapping.model_fields_set}
    for key, alternative in (*PAIRS, *(pair[::-1] for pair in PAIRS)):
        if chosen.get(key) is not None:
            chosen.setdefault(alternative, None)
    return default.model_copy(update=chosen)


GAS_KEYS = ("temperature", "pressure", "density", "fuel")
# OpenFOAM's names of the parcels' fields
PARCEL_FIELDS = {
    "diameter": "d",
    "temperature": "T",
    "density": "rho",
    "number": "nParticle",
    "age": "age",
    "velocity": "U",
    "origin": "position0",
}
PARCEL_NAMES = ParcelColumns.model_validate(PARCEL_FIELDS)
# names of each quantity, the likeliest first; {} is spray.fuel_field
FOAM_NAMES = {"temperature": ("T",), "pressure": ("p",), "density": ("rho",), "fuel": ("{}",)}


def gas_names(
    mapping: CellColumns,
    available: Container[str],
    fuel_field: str,
    default: Mapping[str, tuple[str, ...]] = FOAM_NAMES,
) -> CellColumns:
    """Names of the cell fields: those that a `mapping` sets, else the format's own.

    The first `default` name of a quantity that is among the `available` fields is used. A missing
    field is reported later, where it is needed.
    """
    named = {key: [name.format(fuel_field) for name in names] for key, names in default.items()}
    columns = {key: first_of(names, available) for key, names in named.items()}
    return merged(mapping, CellColumns(**columns))


def first_of(names: Iterable[str], available: Container[str]) -> Scalar | None:
    """Column of the first of the `names` that is `available`; None if none is."""
    column = next((name for name in names if name in available), None)
    return None if column is None else Scalar(column=column)


def columns_of_value(value: object) -> set[str]:
    """Column names of one scalar or vector of a mapping."""
    return ({getattr(value, "column", None) or ""} | set(getattr(value, "columns", ()))) - {""}


def columns_of(mapping: CellColumns | ParcelColumns) -> set[str]:
    """Column names that a part of a mapping uses."""
    return {name for _, value in mapping for name in columns_of_value(value)}
