"""Fields of a CFD result by a mapping, in SI, under OpenFOAM's names.

Parcels, and the gas of several parts, such as zones or files; fields at points become cell means.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import CfdCase, Cloud, Column, complete_cloud, joined
from cldit.cfd.mapping.file import (
    FOAM_NAMES,
    GAS_KEYS,
    PARCEL_FIELDS,
    PARCEL_NAMES,
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Scalar,
    Vector,
    columns_of,
    gas_names,
    merged,
    quantity_in,
    spelled,
    unit_in,
    units_of,
    without_unit,
)
from cldit.cfd.mesh.cells import AnyFloats, CellMesh
from cldit.cfd.mesh.elements import ElementMesh
from cldit.cfd.mesh.faces import Mesh, join
from cldit.errors import SprayError


def with_components(columns: Mapping[str, Column]) -> dict[str, Column]:
    """Adds each component of a vector `U` (N, 3) as `U_X`, `U_Y`, `U_Z` (N,)."""
    parts = {
        f"{name}_{letter}": Column(column.label, part, unit=column.unit)
        for name, column in columns.items()
        if column.values.ndim == 2 and column.values.shape[1] == 3
        for letter, part in zip("XYZ", column.values.T, strict=True)
    }
    return {**parts, **columns}


class Fields(Mapping[str, Column]):
    """Columns by name, each of which is read when it is used."""

    def __init__(self, names: Iterable[str], read: Callable[[str], Column]) -> None:
        self._names, self._read = dict.fromkeys(names), read

    def __getitem__(self, name: str) -> Column:
        return self._read(name)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclass(frozen=True)
class Source:
    """Table or data set: columns by name, number of rows, and its name in errors."""

    name: str
    columns: Mapping[str, Column]
    rows: int

    def scalar(self, quantity: Scalar, key: str) -> Column:
        """Column or constant in SI, (N,); `key` is that of the mapping, as `cells.fuel`."""
        if quantity.value is not None:
            factor, offset = self._unit(quantity.unit, key)
            value = quantity.value * factor + offset
            return Column(f"{self.name}: {key} (constant)", np.full(self.rows, value))
        name, column = self._column(str(quantity.column), key)
        unit = self._stated(name, column, quantity.unit, key)
        factor, offset = self._unit(unit, key, column.label)
        values = column.values
        if column.undefined is not None and column.undefined.any():
            if quantity.undefined is None:
                way = f"{key.partition('.')[2]}: {{column: {quantity.column}, undefined: 0}}"
                raise SprayError(
                    f"{column.label}: {int(column.undefined.sum())} of {len(values)} values are "
                    f"marked as undefined ({key}); a mapping file may replace them: {way}"
                )
            values = np.where(column.undefined, quantity.undefined, values)
        if (factor, offset) != (1.0, 0.0):  # else as it is stored: large columns are not copied
            values = np.asarray(values, np.float64) * factor + offset
        return Column(column.label, values, unit=unit)

    def vector(self, quantity: Vector, key: str) -> Column:
        """Three columns in SI, (N, 3)."""
        named = [self._column(name, key) for name in quantity.columns]
        units = {self._stated(name, column, quantity.unit, key) for name, column in named}
        if len(units) > 1:
            raise SprayError(f"{self.name}: {key}: columns of several units in their names")
        factor, _ = self._unit(units.pop(), key)
        labels = list(dict.fromkeys(column.label for _, column in named))
        label = labels[0] if len(labels) == 1 else f"{self.name}: {', '.join(quantity.columns)}"
        values = np.stack([column.values for _, column in named], axis=1, dtype=np.float64)
        return Column(label, values * factor)

    def _column(self, name: str, key: str) -> tuple[str, Column]:
        """Column of that name, or the only one of that name with a unit: `T` for `T [K]`."""
        if name in self.columns:
            return name, self.columns[name]
        matches = [candidate for candidate in self.columns if without_unit(candidate) == name]
        if len(matches) != 1:
            available = ", ".join(self.columns) or "none"
            raise SprayError(f"{self.name}: no column {name!r} ({key}); it has: {available}")
        return matches[0], self.columns[matches[0]]

    def _stated(self, name: str, column: Column, unit: str | None, key: str) -> str | None:
        """Unit that the mapping gives, else that of the file or in the column's name."""
        meant = quantity_in(name, key.partition(".")[2])
        stated = unit_in(name) or (column.unit and spelled(column.unit))
        stated = meant if stated in (None, "1") and meant is not None else stated
        if stated is None or (unit is not None and stated not in units_of(key.partition(".")[2])):
            return unit
        if unit is None or unit == stated:
            return stated
        raise SprayError(
            f"{self.name}: column {name!r} is in {stated} by its name, and in {unit} by the mapping"
            f" ({key}); give the unit that is right, and the column its name without one"
        )

    def _unit(self, unit: str | None, key: str, label: str = "") -> tuple[float, float]:
        units = units_of(key.partition(".")[2])
        if unit is None:
            return next(iter(units.values()))
        if unit not in units:
            allowed = ", ".join(units)
            where = label or self.name
            raise SprayError(f"{where}: {key}: unit {unit!r} is unknown; allowed: {allowed}")
        return units[unit]


def gas_columns(source: Source, mapping: CellColumns, fuel_field: str) -> dict[str, Column]:
    """Mapped ones of T, p, rho and the fuel's mass fraction, (N,) in SI, by OpenFOAM's names."""
    names = {"temperature": "T", "pressure": "p", "density": "rho", "fuel": fuel_field}
    gas = {
        name: source.scalar(value, f"cells.{key}")
        for key, name in names.items()
        if (value := getattr(mapping, key)) is not None
    }
    for column in gas.values():
        if len(column.values) != source.rows:
            raise SprayError(f"{column.label}: {len(column.values)} values for {source.rows} cells")
    return gas


def cloud_columns(source: Source, mapping: ParcelColumns) -> dict[str, Column]:
    """Mapped columns of parcels in SI, by OpenFOAM's names.

    The number of droplets may come from the parcel's mass, which needs diameter and density.
    """
    fields: dict[str, Column] = {}
    for key, name in (PARCEL_FIELDS | {"origin": "origin"}).items():
        value = getattr(mapping, key)
        if isinstance(value, Vector):
            fields[name] = source.vector(value, f"parcels.{key}")
        elif value is not None:
            fields[name] = source.scalar(value, f"parcels.{key}")
    if mapping.radius is not None and mapping.diameter is None:
        radius = source.scalar(mapping.radius, "parcels.radius")
        fields["d"] = Column(f"{radius.label} (radius, doubled)", 2.0 * radius.values)
    if mapping.mass is not None and "d" in fields and "rho" in fields:
        mass = source.scalar(mapping.mass, "parcels.mass")
        droplet = fields["rho"].values * np.pi / 6 * fields["d"].values ** 3
        dummy = fields["d"].values == 0.0
        if not np.all((droplet > 0.0) | dummy):
            bad = int(np.argmin((droplet > 0.0) | dummy))
            raise SprayError(
                f"{fields['d'].label}: {fields['d'].values[bad]:g} (entry {bad}) with density "
                f"{fields['rho'].values[bad]:g} makes no droplet to divide the parcel's mass by"
            )
        number = np.where(dummy, 0.0, mass.values / np.where(dummy, 1.0, droplet))
        fields["nParticle"] = Column(f"{mass.label} (mass over a droplet's)", number)
    return fields


def joined_cloud(
    name: str,
    source: str,
    parts: Sequence[tuple[Column, dict[str, Column]]],
    names: ColumnMap,
    needed: Container[str] = (),
) -> Cloud:
    """Cloud of all its parts, positions and fields each; empty ones add nothing.

    `needed` fields must be in all parts or in none.
    """
    filled = [part for part in parts if len(part[0].values)] or parts[:1]
    shared = set.intersection(*(set(columns) for _, columns in filled))
    for _, columns in filled:
        if missing := [key for key in set(columns) - shared if key in needed]:
            lacking = f"the field {min(missing)!r} of cloud {name!r}"
            raise SprayError(f"{source}: only some processors have {lacking}")
    position = joined([position for position, _ in filled])
    columns = {key: joined([columns[key] for _, columns in filled]) for key in sorted(shared)}
    return mapped_cloud(name, source, position, with_components(columns), names)


def mapped_cloud(
    name: str,
    source: str,
    position_m: Column,
    columns: dict[str, Column],
    names: ColumnMap,
    default: ParcelColumns = PARCEL_NAMES,
) -> Cloud:
    """Cloud of the `columns` by the mapping, else by those `default` names that are present."""
    parcels = merged(names.parcels, default.among(columns))
    # masses are products of many: of stored floats they would overflow or be rounded at each step
    doubles = {key: _double(columns[key]) for key in columns_of(parcels) & set(columns)}
    rows = Source(source, columns | doubles, len(position_m.values))
    fields = cloud_columns(rows, parcels)
    parts = {f"{key}_{letter}" for key in columns for letter in "XYZ"}  # of vectors that are there
    separate = {key: column for key, column in columns.items() if key not in parts}
    return complete_cloud(name, source, _double(position_m), fields, separate, columns_of(parcels))


def _double(column: Column) -> Column:
    return replace(column, values=np.asarray(column.values, np.float64))


@dataclass(frozen=True)
class MeshPart:
    """Mesh of a zone or file, with fields in cells (N,) and at points (P,) by name.

    mesh: itself, or a function that makes it, which is called only for a part that has the fuel.
    """

    name: str
    mesh: CellMesh | Callable[[], ElementMesh | Mesh]
    cells: Mapping[str, Column]
    points: Mapping[str, Column] = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """Names of its fields."""
        return {*self.cells, *self.points}


def join_gas(
    path: Path,
    parts: Sequence[MeshPart],
    mapping: CellColumns,
    fuel_field: str,
    default: Mapping[str, tuple[str, ...]] = FOAM_NAMES,
) -> CfdCase:
    """Case of these parts, without time and cloud; parts without fuel are omitted."""
    meshes: list[CellMesh] = []
    fields: list[dict[str, Column]] = []
    remarks: list[str] = []
    column_names = [gas_names(mapping, part.names, fuel_field, default) for part in parts]
    pairs = list(zip(parts, column_names, strict=True))
    fuelled = [(part, names) for part, names in pairs if _has_fuel(part, names)] or pairs
    for part, names in fuelled:
        mesh, cells = part.mesh() if callable(part.mesh) else part.mesh, part.cells
        if isinstance(mesh, ElementMesh | Mesh):
            cells, moved = with_point_fields(cells, part.points, names, mesh.corner_mean)
            if moved:
                change = f"{', '.join(moved)} at points became means over cells"
                remarks.append(f"{part.name}: {change}.")
        meshes.append(mesh)
        fields.append(gas_columns(Source(part.name, cells, mesh.cells), names, fuel_field))
    used = [part.name for part, _ in fuelled]
    if skipped := ", ".join(part.name for part in parts if part.name not in used):
        remarks.append(f"Meshes without {fuel_field} were omitted: {skipped}.")
    for columns in fields:
        if odd := set(fields[0]) ^ set(columns):
            raise SprayError(f"{path}: only some of its meshes have the field {min(odd)!r}")
    available = tuple(sorted(set[str]().union(*(part.names for part in parts))))
    gas = {name: joined([part_fields[name] for part_fields in fields]) for name in fields[0]}
    return CfdCase(str(path), None, join(meshes), gas, available, None, remarks=tuple(remarks))


def _has_fuel(part: MeshPart, names: CellColumns) -> bool:
    if names.fuel is None or names.fuel.column is None:
        return names.fuel is not None
    return any(names.fuel.column in (name, without_unit(name)) for name in part.names)


def with_point_fields(
    cells: Mapping[str, Column],
    points: Mapping[str, Column],
    names: CellColumns,
    mean: Callable[[AnyFloats], Floats],
) -> tuple[Mapping[str, Column], tuple[str, ...]]:
    """Adds to the cell fields (N,) those that exist only at points (P,), and lists their names.

    Each corner of a cell represents an equal share of its volume. Density and pressure are means
    over the corners; temperature and mass fraction are means weighted by the density at the
    corners, or by p/T if there is none, which conserves the mass of gas and of fuel. `mean`
    averages values (P,) over the corners of each cell.
    """
    columns = {
        key: value.column
        for key in GAS_KEYS
        if (value := getattr(names, key)) is not None and value.column is not None
    }
    moved = [key for key, name in columns.items() if name not in cells and name in points]
    if not moved:
        return cells, ()
    for name in {columns[key] for key in columns if columns[key] in points}:
        undefined = points[name].undefined
        if undefined is not None and mean(undefined.astype(np.float64)).any():
            raise SprayError(f"{points[name].label}: some corners of cells have no value")
    weight = _weight(points, columns) if {"temperature", "fuel"} & set(moved) else None
    means: dict[str, Column] = {}
    for key in moved:
        column = points[columns[key]]
        values = column.values
        if key in ("temperature", "fuel"):
            if weight is None:
                way = "export cell data (in ParaView: without Cell Data to Point Data)"
                raise SprayError(
                    f"{column.label}: is given at points, without density or pressure at points to "
                    f"weight it by; {way}"
                )
            values = mean(weight * values) / mean(weight)
        else:
            values = mean(values)
        label = f"{column.label} (mean over the corners of a cell)"
        means[columns[key]] = Column(label, values, unit=column.unit)
    instead = " (weighted by p/T, as there is no density at points)"
    weighted = set() if columns.get("density", "") in points else {"temperature", "fuel"}
    combined = Fields((*cells, *means), lambda name: (means if name in means else cells)[name])
    return combined, tuple(columns[key] + (instead if key in weighted else "") for key in moved)


def _weight(points: Mapping[str, Column], columns: Mapping[str, str]) -> Floats | None:
    """Density at the points, or p/T, which is proportional to it."""

    def at(key: str) -> Any:
        column = points.get(columns.get(key, ""))
        if column is None or column.undefined is None:
            return None if column is None else column.values
        return np.where(column.undefined, 1.0, column.values)  # no corner of a cell: checked above

    density, pressure, temperature = at("density"), at("pressure"), at("temperature")
    if density is not None:
        weight = density
    elif pressure is not None and temperature is not None:
        weight = pressure / temperature
    else:
        return None
    return np.asarray(weight) if np.all(weight > 0) else None
