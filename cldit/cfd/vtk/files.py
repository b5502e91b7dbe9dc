"""One time of VTK files as a CFD case."""

from __future__ import annotations

from collections.abc import Sequence, Set
from pathlib import Path

import numpy as np

from cldit.cfd.case import NO_CLOUD, CfdCase, Cloud, Column, choose_cloud, joined
from cldit.cfd.mapping.columns import Source, gas_columns, mapped_cloud, with_components
from cldit.cfd.mapping.file import (
    PARCEL_NAMES,
    ColumnMap,
    columns_of,
    gas_names,
    without_unit,
)
from cldit.cfd.mesh.faces import join
from cldit.cfd.point_data import with_point_fields
from cldit.cfd.times import CaseTime
from cldit.cfd.vtk.datasets import GHOSTS, cell_columns, corner_mean, point_columns, vtk_mesh
from cldit.cfd.vtk.layout import find_layout
from cldit.cfd.vtk.reading import Choose, Loaded, nothing
from cldit.cfd.vtk.steps import Loader, find_step, step_times
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent


def read_vtk(
    path: Path,
    *,
    time_s: CaseTime | None,
    fuel_field: str,
    cloud: str | None,
    names: ColumnMap,
    watch: Watch = silent,
) -> CfdCase:
    """Reads one time of VTK files.

    The path is a file of `DATA`, a collection of such files, a folder of them, or output of
    foamToVTK (`CASE/VTK`, or any file in it: then the step of that file). Times come from .pvd and
    .series files, else from the comment or the `TimeValue` in the file.
    """
    layout = find_layout(_existing(path))
    loader = Loader(_gas_alone(names, fuel_field), watch)
    step = find_step(path, layout, loader, time_s=time_s, cloud=cloud)
    chosen = choose_cloud(str(path), step.clouds, cloud)
    if chosen is None and cloud != NO_CLOUD and layout.beside:
        shown = ", ".join(map(str, layout.beside))
        raise SprayError(
            f"{path}: holds no parcels, but there may be some beside it: {shown}; give the folder "
            f"as the case to read both, or spray.cloud: {NO_CLOUD} for gas alone"
        )
    parts = []
    remarks = list(step.remarks)
    available: set[str] = set()
    skipped = []
    filled = [each for each in step.meshes if each.data.GetNumberOfCells()]
    for loaded in filled or step.meshes[:1]:  # a processor may have no cell
        file, grid = loaded.file, loaded.data
        wanted = gas_names(names.cells, loaded.cell_names | loaded.point_names, fuel_field)
        # those that were not read are named only
        cells = {name: Column("", np.empty(0)) for name in sorted(loaded.cell_names)}
        cells |= cell_columns(file, grid)
        points = point_columns(file, grid)[1]
        cells, moved = with_point_fields(cells, points, wanted, corner_mean(grid))
        available |= set(cells)
        if wanted.fuel is None and len(step.meshes) > 1:
            skipped.append(file)
            continue
        if moved:
            remarks.append(f"{file}: {', '.join(moved)} at points became means over cells.")
        mesh = vtk_mesh(file, grid)
        source = Source(str(file), cells, mesh.cells)
        parts.append((mesh, gas_columns(source, wanted, fuel_field)))
    if not parts:
        raise SprayError(f"{path}: no mesh has the cell field {fuel_field!r} (spray.fuel_field)")
    if skipped:
        shown = ", ".join(map(str, skipped))
        remarks.append(f"Meshes without {fuel_field} are left out: {shown}.")
    first = parts[0][1]
    for _, gas in parts:
        if odd := set(first) ^ set(gas):
            raise SprayError(f"{path}: only some of its meshes have the field {min(odd)!r}")
    return CfdCase(
        source=str(step.meshes[0].file),
        time_s=step.time_s,
        mesh=join([mesh for mesh, _ in parts]),
        gas={name: joined([gas[name] for _, gas in parts]) for name in first},
        available=tuple(sorted(available)),
        cloud=None if chosen is None else _cloud(chosen, step.clouds[chosen], names),
        files=step.files,
        remarks=tuple(remarks),
    )


def list_vtk(
    path: Path, time_s: CaseTime | None
) -> tuple[list[float], list[str], dict[str, list[str]]]:
    """Lists times [s], fields of the mesh, and clouds with their fields, at one time."""
    layout = find_layout(_existing(path))
    loader = Loader(nothing)
    step = find_step(path, layout, loader, time_s=time_s, cloud=NO_CLOUD)
    known = [time for time in step_times(layout, loader).values() if time is not None]
    fields = frozenset[str]().union(*(e.cell_names | e.point_names for e in step.meshes))
    clouds = {
        name: sorted(frozenset[str]().union(*(part.point_names for part in parts)))
        for name, parts in step.clouds.items()
    }
    return known, sorted(fields), clouds


def _existing(path: Path) -> Path:
    if not path.exists():
        raise SprayError(f"{path}: no such file or folder (spray.file)")
    return path.resolve()


def _gas_alone(names: ColumnMap, fuel_field: str) -> Choose:
    """Selects the fields of the gas: at points only if some are missing in the cells."""

    def choose(cells: Set[str], points: Set[str]) -> tuple[Set[str], Set[str]]:
        wanted = columns_of(gas_names(names.cells, cells | points, fuel_field))

        def among(known: Set[str]) -> set[str]:
            return {name for name in known if {name, without_unit(name)} & wanted}

        found = among(cells)
        complete = wanted <= found | {without_unit(name) for name in found}
        at_points = set() if complete else among(points)
        return found | (cells & {GHOSTS}), at_points | (points & {GHOSTS})

    return choose


def _cloud(name: str, parts: Sequence[Loaded], names: ColumnMap) -> Cloud:
    """Cloud of all its pieces; empty ones add nothing."""
    read = [point_columns(part.file, part.data) for part in parts]
    filled = [part for part in read if len(part[0].values)] or read[:1]
    fields = set.intersection(*(set(columns) for _, columns in filled))
    columns: dict[str, Column] = {
        key: joined([part[1][key] for part in filled]) for key in sorted(fields)
    }
    position = joined([part[0] for part in filled])
    file = str(parts[0].file)
    return mapped_cloud(name, file, position, with_components(columns), names, PARCEL_NAMES)
