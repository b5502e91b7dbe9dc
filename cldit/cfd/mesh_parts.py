"""Gas of a case in several parts, such as zones or files; fields at points as cell means."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import CfdCase, Column, joined
from cldit.cfd.mapping.columns import Fields, Source, gas_columns
from cldit.cfd.mapping.file import FOAM_NAMES, GAS_KEYS, CellColumns, gas_names, without_unit
from cldit.cfd.mesh.cells import AnyFloats, CellMesh
from cldit.cfd.mesh.elements import ElementMesh
from cldit.cfd.mesh.faces import Mesh, join
from cldit.errors import SprayError


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
