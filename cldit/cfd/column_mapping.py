"""Mapping files: which column of a CFD result is what, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from cldit.cfd.case import Cloud, Column, complete_cloud
from cldit.errors import SprayError
from cldit.scene.checks import Section, describe, read_mapping

# unit: factor and offset to SI, value * factor + offset
_PLAIN = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "volume": {"m3": 1.0, "l": 1e-3, "cm3": 1e-6, "mm3": 1e-9},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "atm": 101325.0},
    "density": {"kg/m3": 1.0, "g/cm3": 1e3, "g/l": 1.0},
    "fraction": {"1": 1.0, "%": 1e-2},
    "count": {"1": 1.0},
    "mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "ug": 1e-9},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
}
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    kind: {unit: (factor, 0.0) for unit, factor in units.items()} for kind, units in _PLAIN.items()
} | {"temperature": {"K": (1.0, 0.0), "degC": (1.0, 273.15), "degF": (5 / 9, 459.67 * 5 / 9)}}


_UNIT = re.compile(r"\s*[\[(]([^\])]*)[\])]$")  # at the end of a column's name
_SPELLED = (
    {"-": "1", "": "1", "C": "degC", "°C": "degC", "F": "degF", "°F": "degF"}
    | {"m^3": "m3", "mm^3": "mm3", "cm^3": "cm3", "m³": "m3", "mm³": "mm3", "cm³": "cm3"}
    | {"kg/m^3": "kg/m3", "kg/m³": "kg/m3", "g/cm^3": "g/cm3", "g/cm³": "g/cm3"}
    | {"kg m^-3": "kg/m3", "m s^-1": "m/s", "µm": "um", "μm": "um", "micron": "um", "microns": "um"}
)


def without_unit(name: str) -> str:
    """A column's name without the unit at its end: `T` of `T [K]`."""
    return _UNIT.sub("", name)


class Scalar(Section):
    """A column by name, or a constant `value`; `unit` is SI where left out.

    undefined: what stands for values that the file marks as undefined, in the same unit.
    """

    column: str | None = None
    value: float | None = None
    unit: str | None = None
    undefined: float | None = None

    @model_validator(mode="after")
    def _one(self) -> Scalar:
        if (self.column is None) == (self.value is None):
            raise ValueError("needs either column or value")
        return self


class Vector(Section):
    """Three columns by name; `unit` is SI where left out."""

    columns: tuple[str, str, str]
    unit: str | None = None


def _short_scalar(given: object) -> object:
    if isinstance(given, str):
        return {"column": given}
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        return {"value": given}
    return given


def _short_vector(given: object) -> object:
    if isinstance(given, str):  # the name of a vector
        return {"columns": [f"{given}_{letter}" for letter in "XYZ"]}
    return {"columns": given} if isinstance(given, (list, tuple)) else given


A = Annotated[Scalar | None, BeforeValidator(_short_scalar)]
V = Annotated[Vector | None, BeforeValidator(_short_vector)]


class Table(Section):
    """Where a table lies and how it is written; only for `format: tables`.

    delimiter: told by the header where left out; a space is any white space. decimal: the mark in
    numbers.
    """

    file: Path | None = None
    delimiter: str | None = Field(None, min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    header_line: int = Field(1, ge=1, le=1000)


class CellColumns(Table):
    """The gas. `position` and `size` or `volume` only for tables."""

    position: V = None
    size: V = None
    volume: A = None
    temperature: A = None
    pressure: A = None
    density: A = None
    fuel: A = None


class ParcelColumns(Table):
    """The droplets. `position` only for tables; `mass` is that of all droplets of the parcel.

    origin: where the parcel was born.
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
    def _once(self) -> ParcelColumns:
        for one, other in (("diameter", "radius"), ("number", "mass")):
            if getattr(self, one) is not None and getattr(self, other) is not None:
                raise ValueError(f"{one} and {other} are both given; allowed is one of them")
        return self


class ColumnMap(Section):
    """A whole mapping file."""

    time_s: float | None = None
    cells: CellColumns = CellColumns()
    parcels: ParcelColumns | None = None


def read_column_map(path: Path) -> ColumnMap:
    """Reads a mapping file.

    Raises:
        SprayError: it is missing, not YAML, or has a key or value that is not allowed.
    """
    try:
        return ColumnMap.model_validate(read_mapping(path))
    except ValidationError as error:
        raise SprayError(f"{path}: {describe(ColumnMap, error.errors())}") from error
    except ValueError as error:  # of read_mapping, which names the file
        raise SprayError(str(error)) from error


S = TypeVar("S", CellColumns, ParcelColumns)


def merged(given: S | None, default: S) -> S:
    """`default`, with what the mapping file has `given` in its place; a pair's other half goes."""
    if given is None:
        return default
    chosen = {name: getattr(given, name) for name in given.model_fields_set}
    for one, other in (("diameter", "radius"), ("number", "mass")):
        for here, there in ((one, other), (other, one)):
            if chosen.get(here) is not None:
                chosen.setdefault(there, None)
    return default.model_copy(update=chosen)


GAS_KEYS = ("temperature", "pressure", "density", "fuel")
PARCEL_NAMES = ParcelColumns(
    diameter=Scalar(column="d"),
    number=Scalar(column="nParticle"),
    temperature=Scalar(column="T"),
    density=Scalar(column="rho"),
    velocity=Vector(columns=("U_X", "U_Y", "U_Z")),
    age=Scalar(column="age"),
    origin=Vector(columns=("position0_X", "position0_Y", "position0_Z")),
)


def gas_names(given: CellColumns, known: Container[str], fuel_field: str) -> CellColumns:
    """OpenFOAM's names of the cell fields, with what a mapping has `given` in their place.

    Args:
        given: of the mapping.
        known: the fields that there are. A default that is not there is left out: it is missed
            later, by who knows whether it is needed.
        fuel_field: default of the fuel's mass fraction.
    """
    default = {"temperature": "T", "pressure": "p", "density": "rho", "fuel": fuel_field}
    there = {key: Scalar(column=name) for key, name in default.items() if name in known}
    return merged(given, CellColumns(**{key: there.get(key) for key in GAS_KEYS}))


def columns_of(wanted: CellColumns | ParcelColumns) -> set[str]:
    """The names of all columns that a part of a mapping uses."""
    used: set[str] = set()
    for key in type(wanted).model_fields:
        value = getattr(wanted, key)
        used |= {getattr(value, "column", None) or ""} | set(getattr(value, "columns", ()))
    return used - {""}


def with_components(columns: Mapping[str, Column]) -> dict[str, Column]:
    """The columns, and each component of a vector `U` (N, 3) as `U_X`, `U_Y`, `U_Z` (N,)."""
    parts = {
        f"{name}_{letter}": Column(column.label, part)
        for name, column in columns.items()
        if column.values.ndim == 2 and column.values.shape[1] == 3
        for letter, part in zip("XYZ", column.values.T, strict=True)
    }
    return {**parts, **columns}


@dataclass(frozen=True)
class Source:
    """Columns of one table or data set by name, the number of its rows, and its name in errors."""

    name: str
    columns: Mapping[str, Column]
    rows: int

    def scalar(self, wanted: Scalar, kind: str, key: str) -> Column:
        """A column (or constant) in SI, (N,).

        Args:
            wanted: column or constant, and unit.
            kind: of the unit.
            key: named by errors.

        Raises:
            SprayError: there is no such column, or no such unit for this kind.
        """
        if wanted.value is not None:
            factor, offset = self._unit(wanted.unit, kind, key)
            value = wanted.value * factor + offset
            return Column(f"{self.name}: {key} (constant)", np.full(self.rows, value))
        name, found = self._column(str(wanted.column), key)
        factor, offset = self._unit(self._stated(name, wanted.unit, kind, key), kind, key)
        values = found.values
        if found.undefined is not None and found.undefined.any():
            if wanted.undefined is None:
                short = key.partition(".")[2]
                raise SprayError(
                    f"{found.label}: {int(found.undefined.sum())} of {len(values)} values are "
                    f"marked as undefined ({key}); a mapping file may say what stands for them: "
                    f"{short}: {{column: {wanted.column}, undefined: 0}}"
                )
            values = np.where(found.undefined, wanted.undefined, values)
        if (factor, offset) != (1.0, 0.0):  # else as it is stored: large columns are not copied
            values = np.asarray(values, np.float64) * factor + offset
        return Column(found.label, values)

    def vector(self, wanted: Vector, kind: str, key: str) -> Column:
        """Three columns in SI, (N, 3).

        Args:
            wanted: columns and unit.
            kind: of the unit.
            key: named by errors.
        """
        named = [self._column(name, key) for name in wanted.columns]
        units = {self._stated(name, wanted.unit, kind, key) for name, _ in named}
        if len(units) > 1:
            raise SprayError(f"{self.name}: {key}: columns of several units in their names")
        factor, _ = self._unit(units.pop(), kind, key)
        parts = [column for _, column in named]
        labels = list(dict.fromkeys(part.label for part in parts))
        label = labels[0] if len(labels) == 1 else f"{self.name}: {', '.join(wanted.columns)}"
        values = np.stack([part.values for part in parts], axis=1, dtype=np.float64)
        return Column(label, values * factor)

    def _column(self, name: str, key: str) -> tuple[str, Column]:
        """The column of that name, or the only one of that name and a unit: `T` for `T [K]`."""
        if name in self.columns:
            return name, self.columns[name]
        found = [each for each in self.columns if without_unit(each) == name]
        if len(found) != 1:
            known = ", ".join(self.columns) or "none"
            raise SprayError(f"{self.name}: no column {name!r} ({key}); it has: {known}")
        return found[0], self.columns[found[0]]

    def _stated(self, name: str, unit: str | None, kind: str, key: str) -> str | None:
        """The unit that the mapping gives, or else that in the column's name."""
        match = _UNIT.search(name)
        stated = None if match is None else _SPELLED.get(match[1].strip(), match[1].strip())
        if stated is None or (unit is not None and stated not in UNITS[kind]):
            return unit
        if unit is None or unit == stated:
            return stated
        raise SprayError(
            f"{self.name}: column {name!r} is in {stated} by its name, and in {unit} by the mapping"
            f" ({key}); give the unit that is right, and the column its name without one"
        )

    def _unit(self, unit: str | None, kind: str, key: str) -> tuple[float, float]:
        known = UNITS[kind]
        if unit is None:
            return next(iter(known.values()))
        if unit not in known:
            raise SprayError(
                f"{self.name}: {key}: unit {unit!r} is unknown; allowed for a {kind}: "
                + ", ".join(known)
            )
        return known[unit]


def gas_columns(source: Source, wanted: CellColumns, fuel_field: str) -> dict[str, Column]:
    """T, p, rho and the fuel's mass fraction, those that are mapped, in SI.

    Args:
        source: the table.
        wanted: the mapping.
        fuel_field: name of the fuel's mass fraction.

    Returns:
        Columns (N,) by OpenFOAM's names.
    """
    keys = (
        ("T", "temperature", "temperature"),
        ("p", "pressure", "pressure"),
        ("rho", "density", "density"),
        (fuel_field, "fuel", "fraction"),
    )
    return {
        name: source.scalar(getattr(wanted, key), kind, f"cells.{key}")
        for name, key, kind in keys
        if getattr(wanted, key) is not None
    }


def cloud_columns(source: Source, wanted: ParcelColumns) -> dict[str, Column]:
    """The columns of `source` that are mapped by `wanted`, in SI, by OpenFOAM's names.

    d, T and rho come first, then nParticle, U, age and origin.

    Raises:
        SprayError: the number is to come from the mass, and a diameter or density is not above 0.
    """
    fields: dict[str, Column] = {}
    if wanted.diameter is not None:
        fields["d"] = source.scalar(wanted.diameter, "length", "parcels.diameter")
    elif wanted.radius is not None:
        radius = source.scalar(wanted.radius, "length", "parcels.radius")
        fields["d"] = Column(f"{radius.label} (radius, doubled)", 2.0 * radius.values)
    for name, key, kind in (
        ("T", "temperature", "temperature"),
        ("rho", "density", "density"),
        ("nParticle", "number", "count"),
        ("age", "age", "time"),
    ):
        if getattr(wanted, key) is not None:
            fields[name] = source.scalar(getattr(wanted, key), kind, f"parcels.{key}")
    if wanted.velocity is not None:
        fields["U"] = source.vector(wanted.velocity, "velocity", "parcels.velocity")
    if wanted.origin is not None:
        fields["origin"] = source.vector(wanted.origin, "length", "parcels.origin")
    if wanted.mass is not None and "d" in fields and "rho" in fields:
        mass = source.scalar(wanted.mass, "mass", "parcels.mass")
        droplet = fields["rho"].values * np.pi / 6 * fields["d"].values ** 3
        if not np.all(droplet > 0.0):
            bad = int(np.argmin(droplet > 0.0))
            raise SprayError(
                f"{fields['d'].label}: {fields['d'].values[bad]:g} (entry {bad}) with density "
                f"{fields['rho'].values[bad]:g} makes no droplet to divide the parcel's mass by"
            )
        fields["nParticle"] = Column(f"{mass.label} (mass over a droplet's)", mass.values / droplet)
    return fields


def mapped_cloud(
    name: str,
    source: str,
    position_m: Column,
    columns: dict[str, Column],
    names: ColumnMap,
    default: ParcelColumns,
) -> Cloud:
    """The cloud of these columns by the mapping, or by the default names that there are.

    Args:
        name: of the cloud.
        source: named by errors.
        position_m: (N, 3).
        columns: all that there are, by name.
        names: the mapping.
        default: used where the mapping gives nothing and the columns are there.
    """
    parcels = merged(names.parcels, default)
    given = names.parcels.model_fields_set if names.parcels is not None else set()
    missing: dict[str, None] = {}
    for key in type(parcels).model_fields:
        value = getattr(parcels, key)
        used = getattr(value, "columns", None) or [getattr(value, "column", None)]
        if value is not None and key not in given and any(u and u not in columns for u in used):
            missing[key] = None
    # masses are products of many: of stored floats they would overflow or be rounded at each step
    doubles = {key: _double(columns[key]) for key in columns_of(parcels) & set(columns)}
    rows = Source(source, columns | doubles, len(position_m.values))
    fields = cloud_columns(rows, parcels.model_copy(update=missing))
    parts = {f"{key}_{letter}" for key in columns for letter in "XYZ"}  # of vectors that are there
    return complete_cloud(name, source, _double(position_m), fields, set(columns) - parts)


def _double(column: Column) -> Column:
    return replace(column, values=np.asarray(column.values, np.float64))
