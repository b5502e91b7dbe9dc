"""CONVERGE's post files in HDF5: polyhedral mesh, cell fields, parcels (by their radius).

Layout after vtk's reader of such files (vtkCONVERGECFDReader), read through h5py: that reader takes
sibling files for other times and does not notice arrays of the wrong length.
"""

import re
from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import CfdCase, Cloud, Column, Listing, choose_cloud, only_claimant, stated_time
from cldit.cfd.hdf.arrays import field, hdf_files, labels, open_hdf, unit_of
from cldit.cfd.inputs import Size, check_room
from cldit.cfd.mapping.columns import Fields, MeshPart, join_gas, mapped_cloud
from cldit.cfd.mapping.file import (
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Vector,
    first_of,
    spelled,
)
from cldit.cfd.mesh.faces import Mesh, mesh_of_sides
from cldit.errors import EmptyCloud, SprayError
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray

_STREAM = re.compile(r"STREAM_\d+$")
CONVERGE_NAMES = {
    "temperature": ("TEMPERATURE", "TEMP"),
    "pressure": ("PRESSURE", "PRES"),
    "density": ("DENSITY", "RHO"),
    "fuel": ("{}", "MASSFRAC_{}"),
}
_PARCEL = {
    "radius": ("RADIUS", "PARCEL_RADIUS"),
    "number": ("NUM_DROP", "NUM_DROPS", "NUMBER_OF_DROPS", "PARCEL_NUM_DROP"),
    "temperature": ("TEMP", "TEMPERATURE", "PARCEL_TEMP"),
    "density": ("DENSITY", "RHO", "PARCEL_DENSITY"),
    "age": ("LIFETIME", "PARCEL_AGE"),
}
_VELOCITY = ("VELOCITY", "UU", "PARCEL_VELOCITY")


def read_converge(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads one time of a post file, or of a folder of them."""
    _, at, chosen = _chosen(spec)
    with open_hdf(chosen) as post:
        streams = [post[name] for name in sorted(post) if _STREAM.match(name)]
        if not streams:
            if "openPMD" in post.attrs:
                way = "convert fields and particles to .vtu and .vtp, or to tables"
                raise SprayError(f"{chosen}: is openPMD, which is not read; {way}")
            hint = "Fluent's are named .cas.h5 and .dat.h5, VTK's HDF .vtkhdf"
            raise SprayError(f"{chosen}: no STREAM_00, so no post file of CONVERGE ({hint})")
        check_room(chosen, _size(streams))

        def read(stream: Any, name: str) -> Column:
            watch(f"reading {name}", 0, 1)
            place = f"CELL_CENTER_DATA/{name}"
            unit = unit_of(stream[place])
            return Column(f"{chosen}: cell field {name}", field(chosen, stream, place), unit=unit)

        parts = [
            MeshPart(
                f"{chosen}: {stream.name.strip('/')}",
                partial(post_mesh, chosen, stream),
                Fields(sorted(stream.get("CELL_CENTER_DATA", ())), partial(read, stream)),
            )
            for stream in streams
        ]
        watch("reading the mesh", 0, 1)
        gas = join_gas(chosen, parts, names.cells, spec.fuel_field, CONVERGE_NAMES)
        several = tuple(_chosen_among(chosen, gas.available, names.cells))
        cloud = _cloud(chosen, streams, spec.cloud, names)
        remarks = (*gas.remarks, *several)
        return replace(gas, time_s=at, cloud=cloud, files=hdf_files(chosen), remarks=remarks)


def _chosen(spec: CfdSpray) -> tuple[list[float], float | None, Path]:
    """Times [s] of the files, that asked for (None: not stated), and its file.

    The files are `spec.file`, or all .h5 files of a folder.
    """
    path, by_time = spec.file, dict[float | None, list[Path]]()
    for source in sorted(path.glob("*.h5")) if path.is_dir() else [path]:
        with open_hdf(source) as file:
            value = np.asarray(file.attrs.get("OUTPUT_TIME", [])).reshape(-1)
        by_time.setdefault(float(value[0]) if len(value) else None, []).append(source)
    if not by_time:
        raise SprayError(f"{path}: no .h5 file in it")
    times = [time for time in by_time if time is not None]
    if len(times) < len(by_time) > 1:
        raise SprayError(f"{path}: a file has no OUTPUT_TIME; give the path of one file")
    at = stated_time(str(path), times, spec.time_s)
    role = "the only one without OUTPUT_TIME" if at is None else f"time {at:g}"
    return times, at, only_claimant(role, by_time[at])


# bytes for each number; a corner is held as it is stored and as a label
_HELD = {
    "CONNECTIVITY/POLYGON_TO_VERTEX": 12,
    "CONNECTIVITY/POLYGON_OFFSET": 44,
    "VERTEX_COORDINATES/X": 48,
}


def _size(streams: list[Any]) -> Size:
    """Estimate from the shapes of the arrays."""

    def count(group: Any, name: str) -> int:
        return int(group[name].size) if name in group else 0

    held = sum(count(stream, name) * width for stream in streams for name, width in _HELD.items())
    fields = [stream.get("CELL_CENTER_DATA", {}).values() for stream in streams]
    cells = sum(max((int(array.size) for array in values), default=0) for values in fields)
    groups = [group for stream in streams for group in cloud_groups(stream).values()]
    return Size(cells, sum(count(group, "PARCEL_X") for group in groups), held + 40 * cells)


def _chosen_among(path: Path, available: Sequence[str], mapped: CellColumns) -> Iterator[str]:
    """Remarks on which of several fields was taken for a quantity."""
    for key, names in CONVERGE_NAMES.items():
        present = [name for name in names if name in available]
        if key != "fuel" and len(present) > 1 and key not in mapped.model_fields_set:
            yield f"{path}: of {' and '.join(present)}, {present[0]} was used as the {key}."


def cloud_groups(stream: Any) -> dict[str, Any]:
    """Groups of parcels by name: PARCEL_DATA itself, or PARCEL_DATA/KIND/NAME (3.1 and later)."""
    root = stream.get("PARCEL_DATA")
    if root is None:
        return {}
    if "PARCEL_X" in root:
        return {"PARCEL_DATA": root}
    return {f"{kind}/{name}": root[kind][name] for kind in root for name in root[kind]}


def _cloud(path: Path, streams: list[Any], choice: str | None, names: ColumnMap) -> Cloud | None:
    groups = [cloud_groups(stream) for stream in streams]
    clouds = [pair for group in groups for pair in group.items()]
    present = {name for name, _ in clouds}
    filled = {key for key, group in clouds if key == choice or len(group.get("PARCEL_X", ())) > 0}
    if present and not filled and choice is None:
        raise EmptyCloud(f"{path}: no parcel in {', '.join(sorted(present))}")
    chosen = choose_cloud(str(path), filled, choice)
    if chosen is None:
        return None
    parts = [group[chosen] for group in groups if chosen in group]
    fields = sorted(set.intersection(*(set(part) for part in parts)))
    for part in parts:
        _check_metres(path, part, "PARCEL_X")
    label = f"{path}: {chosen}"

    def column(name: str) -> Column:
        counts = [len(field(path, part, "PARCEL_X")) for part in parts]
        values = [field(path, part, name, n) for part, n in zip(parts, counts, strict=True)]
        return Column(f"{label}/{name}", np.concatenate(values), unit=unit_of(parts[0][name]))

    position = np.stack([column(f"PARCEL_{letter}").values for letter in "XYZ"], axis=1)
    columns = {name: column(name) for name in fields if not re.match("PARCEL_[XYZ]$", name)}
    place = Column(f"{label}/PARCEL_X, _Y, _Z", position)
    return mapped_cloud(chosen, label, place, columns, names, parcel_names(columns))


def parcel_names(columns: Container[str]) -> ParcelColumns:
    """Names of CONVERGE that are among the columns of parcels."""
    default: dict[str, Any] = {key: first_of(aliases, columns) for key, aliases in _PARCEL.items()}
    vectors = [(f"{name}_X", f"{name}_Y", f"{name}_Z") for name in _VELOCITY]
    velocity = next((vector for vector in vectors if all(name in columns for name in vector)), None)
    default["velocity"] = None if velocity is None else Vector(columns=velocity)
    return ParcelColumns(**default)


def list_converge(spec: CfdSpray) -> Listing:
    """Lists times [s], cell fields, and clouds with their fields, at the time asked for."""
    times, _, chosen = _chosen(spec)
    fields: set[str] = set()
    clouds: dict[str, list[str]] = {}
    with open_hdf(chosen) as post:
        for name in post:
            if _STREAM.match(name):
                fields |= set(post[name].get("CELL_CENTER_DATA", ()))
                clouds |= {key: sorted(part) for key, part in cloud_groups(post[name]).items()}
    return times, sorted(fields), clouds


def _check_metres(path: Path, group: Any, name: str) -> None:
    """Refuses coordinates that state another unit."""
    unit = unit_of(group[name]) if name in group else None
    if unit is not None and spelled(unit) != "m":
        raise SprayError(f"{path}: {group.name}/{name}: is in {unit}; expected: m")


def post_mesh(path: Path, stream: Any) -> Mesh:
    """Mesh of a stream, which is a group of the file."""
    _check_metres(path, stream, "VERTEX_COORDINATES/X")
    x = field(path, stream, "VERTEX_COORDINATES/X")
    y, z = (field(path, stream, f"VERTEX_COORDINATES/{name}", len(x)) for name in "YZ")
    start = labels(path, stream, "CONNECTIVITY/POLYGON_OFFSET")
    corners = labels(path, stream, "CONNECTIVITY/POLYGON_TO_VERTEX")
    cells = labels(path, stream, "CONNECTIVITY/CONNECTED_CELLS", 2 * max(len(start) - 1, 0))
    sides = cells.reshape(-1, 2).T
    if not sides.size or start[0] != 0 or start[-1] != len(corners) or np.diff(start).min() < 3:
        raise SprayError(f"{path}: {stream.name}/CONNECTIVITY/POLYGON_OFFSET does not fit its mesh")
    if np.any(np.all(sides < 0, axis=0)):
        raise SprayError(f"{path}: {stream.name}/CONNECTIVITY/CONNECTED_CELLS: a face of no cell")
    points, source = np.stack([x, y, z], axis=1), f"{path}: {stream.name}"
    return mesh_of_sides(points, corners, start, sides, int(sides.max()) + 1, source)
