"""Fields at points as fields of cells, so that the mass of gas and of fuel stays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.mapping.file import CellColumns
from cldit.cfd.mesh.cells import AnyFloats
from cldit.errors import SprayError
from cldit.spray.result import Floats


def with_point_fields(
    cells: Mapping[str, Column],
    points: Mapping[str, Column],
    names: CellColumns,
    mean: Callable[[AnyFloats], Floats],
) -> tuple[dict[str, Column], tuple[str, ...]]:
    """The cell fields, and those that there are at points alone.

    Each corner of a cell stands for an equal share of its volume. Density and pressure are means
    over the corners; temperature and mass fraction are means weighted by the density at the
    corners, or by p/T where there is none, so that sums of mass over cells are those over corners.

    Args:
        cells: fields (N,) by name.
        points: fields (P,) by name.
        names: which field is what.
        mean: of values (P,) over the corners of each cell, (N,).

    Returns:
        Fields of cells, and the names of those that came from points, with what they were weighted
        by where that is not the density.

    Raises:
        SprayError: an intensive field is at points, and nothing to weight it by.
    """
    wanted = {
        key: value.column
        for key in ("temperature", "pressure", "density", "fuel")
        if (value := getattr(names, key)) is not None and value.column is not None
    }
    moved = [key for key, name in wanted.items() if name not in cells and name in points]
    if not moved:
        return dict(cells), ()
    for name in {wanted[key] for key in wanted if wanted[key] in points}:
        undefined = points[name].undefined
        if undefined is not None and mean(undefined.astype(np.float64)).any():
            raise SprayError(f"{points[name].label}: some corners of cells have no value")
    weight = _weight(points, wanted) if {"temperature", "fuel"} & set(moved) else None
    found = dict(cells)
    for key in moved:
        column = points[wanted[key]]
        values = column.values
        if key in ("temperature", "fuel"):
            if weight is None:
                raise SprayError(
                    f"{column.label}: is given at points, without density or pressure at points "
                    "to weight it by; export cell data (in ParaView: without Cell Data to Point "
                    "Data)"
                )
            values = mean(weight * values) / mean(weight)
        else:
            values = mean(values)
        found[wanted[key]] = Column(f"{column.label} (mean over the corners of a cell)", values)
    instead = " (weighted by p/T, as there is no density at points)"
    by_density = wanted.get("density", "") in points
    return found, tuple(
        wanted[key] + (instead if key in ("temperature", "fuel") and not by_density else "")
        for key in moved
    )


def _weight(points: Mapping[str, Column], wanted: Mapping[str, str]) -> Floats | None:
    """Density at the points, or what is in proportion to it."""

    def at(key: str) -> Any:
        column = points.get(wanted.get(key, ""))
        if column is None or column.undefined is None:
            return None if column is None else column.values
        return np.where(column.undefined, 1.0, column.values)  # no corner of a cell: checked above

    density, pressure, temperature = at("density"), at("pressure"), at("temperature")
    if density is not None:
        found = density
    elif pressure is not None and temperature is not None:
        found = pressure / temperature
    else:
        return None
    return np.asarray(found) if np.all(found > 0) else None
