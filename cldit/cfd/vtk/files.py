"""One time of VTK files as a CFD case."""

from collections.abc import Sequence, Set
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cldit.cfd.case import NO_CLOUD, CfdCase, Cloud, Column, Listing, choose_cloud
from cldit.cfd.mapping.columns import MeshPart, join_gas, joined_cloud
from cldit.cfd.mapping.file import (
    PARCEL_NAMES,
    ColumnMap,
    columns_of,
    columns_of_value,
    gas_names,
    merged,
    without_unit,
)
from cldit.cfd.vtk.datasets import GHOSTS, cell_columns, point_columns, time_value, vtk_mesh
from cldit.cfd.vtk.layout import Layout, find_layout
from cldit.cfd.vtk.reading import Choose, Loaded, nothing
from cldit.cfd.vtk.steps import Loader, Step, comment_time, find_step, step_times
from cldit.errors import SprayError
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray


def read_vtk(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads one time of VTK files.

    The path is a file of `DATA`, a collection of such files, a folder of them, or output of
    foamToVTK (`CASE/VTK`, or any file in it: then the step of that file). Times come from .pvd and
    .series files, else from the comment or the `TimeValue` in the file.
    """
    path = spec.file
    layout = find_layout(path)
    loader = Loader(_gas_alone(names, spec.fuel_field), watch)
    drops = _parcel_fields(names)
    step = find_step(path, layout, loader, time_s=spec.time_s, cloud=spec.cloud, drops=drops)
    chosen = choose_cloud(str(path), step.clouds, spec.cloud)
    if chosen is None and spec.cloud != NO_CLOUD and layout.beside:
        shown = ", ".join(map(str, layout.beside))
        way = f"give the folder to read both, or set spray.cloud: {NO_CLOUD} for gas alone"
        raise SprayError(f"{path}: no parcels, but there may be some in {shown}; {way}")
    filled = [piece for piece in step.meshes if piece.data.GetNumberOfCells()]
    parts = [_part(piece) for piece in filled or step.meshes[:1]]  # a processor may have no cell
    case = join_gas(path, parts, names.cells, spec.fuel_field)
    return replace(
        case,
        source=str(step.meshes[0].file),
        time_s=step.time_s,
        cloud=None if chosen is None else _cloud(chosen, step.clouds[chosen], names),
        files=step.files,
        remarks=(*step.remarks, *case.remarks),
        times_s=_times(step, chosen) | _listed(layout, step.time_s),
    )


def _times(step: Step, cloud: str | None) -> dict[Path, float]:
    """Times that the files of the gas and of the cloud state in themselves."""
    read = [*step.meshes, *([] if cloud is None else step.clouds[cloud])]
    stated = ((piece.file, (comment_time(piece.file), time_value(piece.data))) for piece in read)
    return {file: time for file, times in stated for time in times if time is not None}


def _listed(layout: Layout, time_s: float | None) -> dict[Path, float]:
    """Time of the step by each `.series` that lists it, in the unit of foamToVTK's files."""
    return {
        file: time
        for file, items in layout.listed.items()
        for _, time, _ in items
        if time == time_s
    }


def _part(loaded: Loaded) -> MeshPart:
    """Mesh and fields of a file; cell fields that were not read are only named."""
    file, grid = loaded.file, loaded.data
    cells = {name: Column("", np.empty(0)) for name in sorted(loaded.cell_names)}
    cells |= cell_columns(file, grid)
    points = point_columns(file, grid)[1]
    points.pop(GHOSTS, None)
    return MeshPart(str(file), partial(vtk_mesh, file, grid), cells, points)


def list_vtk(spec: CfdSpray) -> Listing:
    """Lists times [s], fields of the mesh, and clouds with their fields, at one time."""
    layout = find_layout(spec.file)
    loader = Loader(nothing)
    drops = _parcel_fields(ColumnMap())
    step = find_step(spec.file, layout, loader, time_s=spec.time_s, cloud=NO_CLOUD, drops=drops)
    times = [time for time in step_times(layout, loader).values() if time is not None]
    fields = frozenset[str]().union(*(e.cell_names | e.point_names for e in step.meshes))
    clouds = {
        name: sorted({field for part in parts for field in part.point_names})
        for name, parts in step.clouds.items()
    }
    return times, sorted(fields), clouds


def _parcel_fields(names: ColumnMap) -> tuple[str, ...]:
    """Names of the size of droplets and their number, or mass, in a parcel."""
    mapping = merged(names.parcels, PARCEL_NAMES)
    pairs = ((mapping.diameter, mapping.radius), (mapping.number, mapping.mass))
    return tuple(name for pair in pairs for value in pair for name in columns_of_value(value))


def _gas_alone(names: ColumnMap, fuel_field: str) -> Choose:
    """Selects the fields of the gas: at points only if some are missing in the cells."""

    def choose(cells: Set[str], points: Set[str]) -> tuple[Set[str], Set[str]]:
        columns = columns_of(gas_names(names.cells, cells | points, fuel_field))

        def among(fields: Set[str]) -> set[str]:
            return {name for name in fields if {name, without_unit(name)} & columns}

        in_cells = among(cells)
        complete = columns <= in_cells | {without_unit(name) for name in in_cells}
        at_points = set() if complete else among(points)
        return in_cells | (cells & {GHOSTS}), at_points | (points & {GHOSTS})

    return choose


def _cloud(name: str, parts: Sequence[Loaded], names: ColumnMap) -> Cloud:
    """Cloud of all its pieces; empty ones add nothing."""
    read = [point_columns(part.file, part.data) for part in parts]
    return joined_cloud(name, str(parts[0].file), read, names)
