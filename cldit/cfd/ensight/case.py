"""EnSight Gold cases with measured particles: mesh, fields per element, parcels.

Why vtk's reader is not used: docs/benchmarks/decided.md.
"""

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from cldit.cfd.case import (
    NO_CLOUD,
    CfdCase,
    Cloud,
    Column,
    Listing,
    choose_cloud,
    choose_file,
    choose_time,
    only_claimant,
)
from cldit.cfd.ensight.file import Item, Reader, read_case_file
from cldit.cfd.ensight.geometry import corner_mean, read_geometry, read_variable
from cldit.cfd.inputs import Size, check_room
from cldit.cfd.mapping.columns import Source, gas_columns, mapped_cloud, with_point_fields
from cldit.cfd.mapping.file import ColumnMap, columns_of, gas_names
from cldit.cfd.tolerances import ROUNDED
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray

_NUMBERED = re.compile(r"c\d+(?=\D)")
_MEASURED = ("scalar per measured node", "vector per measured node")


def read_ensight(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads one time of a .case file, or of the only one in a folder."""
    path, fuel_field = case_path(spec.file), spec.fuel_field
    entries = read_case_file(path)
    items = {item.name: item for item in entries if item.kind == "scalar per node"}
    items |= {item.name: item for item in entries if item.kind == "scalar per element"}
    cells = gas_names(names.cells, items, fuel_field)
    fields = sorted(columns_of(cells) & set(items))
    clouds, at = {} if spec.cloud == NO_CLOUD else _clouds(path, entries), None
    if times(entries):
        common = _common_times(path, entries, [items[name] for name in fields], clouds)
        at = choose_time(str(path), common, spec.time_s)
    model = _file(path, _model(path, entries), at)
    check_room(model, _size(model, [_file(path, items[name], at) for name in fields]))
    watch("reading the mesh", 0, 1)
    geometry = Reader(model)
    solid = read_geometry(geometry)
    geometry.close()
    mesh = solid.mesh
    files = [path, geometry.path]
    columns = {name: Column("", np.empty(0)) for name in items}
    points: dict[str, Column] = {}
    for number, name in enumerate(fields):
        watch(f"reading {name}", number, len(fields))
        reader = Reader(_file(path, items[name], at), binary=geometry.binary, order=geometry.order)
        label = f"{reader.path}: field {name}"
        files.append(reader.path)
        at_nodes = items[name].kind == "scalar per node"
        count = solid.points if at_nodes else mesh.cells
        field = read_variable(reader, solid.parts, count, label, at_nodes=at_nodes)
        (points if at_nodes else columns)[name] = field
        if at_nodes:
            del columns[name]
    mean = partial(corner_mean, solid.blocks)
    fields_in_cells, moved = with_point_fields(columns, points, cells, mean)
    measured = any(item.kind in _MEASURED for item in entries)
    if not clouds and measured and spec.cloud != NO_CLOUD:
        raise SprayError(f"{path}: GEOMETRY: no `measured` file for the parcels")
    only_one = spec.cloud == "measured" and len(clouds) == 1
    chosen = choose_cloud(str(path), clouds, None if only_one else spec.cloud)
    cloud = None
    if chosen is not None:
        cloud, read = _cloud(path, chosen, *clouds[chosen], at, names, geometry)
        files += read
    remarks = [f"Ghost or blanked cells omitted: {solid.hidden}."] if solid.hidden else []
    if moved:
        remarks.append(f"{path}: {', '.join(moved)} at nodes became means over cells.")
    return CfdCase(
        source=str(path),
        time_s=at,
        mesh=mesh,
        gas=gas_columns(Source(str(path), fields_in_cells, mesh.cells), cells, fuel_field),
        available=tuple(sorted(fields_in_cells)),
        cloud=cloud,
        files=tuple(files),
        remarks=tuple(remarks),
    )


def list_ensight(spec: CfdSpray) -> Listing:
    """Lists times [s], fields of cells and nodes, and clouds with their fields."""
    path = case_path(spec.file)
    entries, kinds = read_case_file(path), ("scalar per element", "scalar per node")
    fields = [item.name for item in entries if item.kind in kinds]
    clouds = {name: list(by_name) for name, (_, by_name) in _clouds(path, entries).items()}
    return times(entries), fields, clouds


def case_path(path: Path) -> Path:
    """Path of the .case file: itself, or the only one in a folder."""
    if not path.is_dir():
        return path
    files = [*path.glob("*.case"), *path.glob("*.encas")]
    if not files:
        raise SprayError(f"{path}: no .case file in it")
    return only_claimant("the EnSight case", files)


def times(entries: Sequence[Item]) -> list[float]:
    """Times at which any file of the case is written."""
    return sorted({time for item in entries for time in item.times})


Clouds = dict[str, tuple[Item, dict[str, Item]]]
"""Positions of each cloud, and its fields by name."""


def _common_times(
    path: Path, entries: Sequence[Item], gas: Sequence[Item], clouds: Clouds
) -> list[float]:
    """Times at which gas and clouds are written."""
    parcels = [item for place, fields in clouds.values() for item in (place, *fields.values())]
    sets = {item.name: item.times for item in gas}
    sets |= {f"parcels' {item.name}": item.times for item in parcels}
    written = {name: steps for name, steps in sets.items() if steps}
    if not written:
        return times(entries)

    def has(steps: list[float], time: float) -> bool:
        return any(abs(step - time) <= ROUNDED * max(abs(time), 1e-9) for step in steps)

    base = next(iter(written.values()))
    common = [time for time in base if all(has(steps, time) for steps in written.values())]
    if not common:
        shown = "; ".join(
            f"{name} at {', '.join(f'{t:g}' for t in steps[:5])}" for name, steps in written.items()
        )
        raise SprayError(
            f"{path}: TIME: no time at which all fields are written: {shown}; export them at "
            f"the same times, or spray.cloud: {NO_CLOUD} for gas alone"
        )
    return sorted(common)


def _model(path: Path, entries: Sequence[Item]) -> Item:
    models = [item for item in entries if item.kind == "model"]
    if len(models) != 1:
        raise SprayError(f"{path}: GEOMETRY: {len(models)} entries 'model', expected one")
    return models[0]


def _file(path: Path, item: Item, at: float | None) -> Path:
    """File of an item of the case `path` at a time; a mesh is valid until the next one."""
    files = item.files
    if files[0][0] is None or at is None:
        return files[-1][1]
    if item.kind == "model":
        earlier = [(t, f) for t, f in files if t is not None and t <= at * (1 + 1e-9)]
        return max(earlier or files[:1])[1]
    by_time: dict[float, list[Path]] = {}
    for time, file in files:
        if time is not None:
            by_time.setdefault(time, []).append(file)
    return choose_file(f"{path}: {item.name}", by_time, at, f"{item.name} at ")[1]


def _size(geometry: Path, fields: list[Path]) -> Size:
    """Estimate from the files' sizes: a number takes four bytes, or a line in ascii."""
    try:
        with open_regular(geometry) as stream:
            binary = b"C Binary" in stream.read(84)
        stored = geometry.stat().st_size
        largest = max((file.stat().st_size for file in fields), default=0)
    except OSError:  # the reader reports it
        return Size(0, 0, 0.0)
    return Size(largest // (4 if binary else 13), 0, (2.5 if binary else 7.0) * stored)


def _clouds(path: Path, entries: Sequence[Item]) -> Clouds:
    """Clouds of a case.

    The particles are one cloud, `measured`. foamToEnsight names a cloud by the folder of its files,
    and its fields by the cloud's number and the field: `c0d` in `lagrangian/sprayCloud`.
    """
    by_cloud: Clouds = {}
    fields = [item for item in entries if item.kind in _MEASURED]
    for position in (item for item in entries if item.kind == "measured"):
        folder = position.files[0][1].parent
        foam = folder.parent.name == "lagrangian"
        home = folder.parts[-2:]  # without the folder of a time
        members = [i for i in fields if not foam or i.files[0][1].parent.parts[-2:] == home]
        prefixed = foam and all(_NUMBERED.match(item.name) for item in members)
        named = {_NUMBERED.sub("", item.name) if prefixed else item.name: item for item in members}
        name = folder.name if foam else "measured"
        if name in by_cloud:
            raise SprayError(f"{path}: GEOMETRY: two clouds are named {name!r}")
        by_cloud[name] = (position, named)
    return by_cloud


def _cloud(
    path: Path,
    name: str,
    place: Item,
    fields: dict[str, Item],
    at: float | None,
    names: ColumnMap,
    mesh: Reader,
) -> tuple[Cloud, list[Path]]:
    """Cloud of the case `path`, and the files read; their byte order is that of the mesh."""
    file = Reader(_file(path, place, at), order=mesh.order)
    files = [file.path]
    file.text()
    if (line := file.text()) != "particle coordinates":
        raise file.fail(f"{line!r}, expected `particle coordinates`")
    count = int(file.integers(1)[0])
    position = Column(f"{file.path}: positions", file.particles(count))
    if not file.done:
        raise file.fail(f"continues after its {count} parcels")
    columns: dict[str, Column] = {}
    for field_name, item in fields.items():
        values = Reader(_file(path, item, at), binary=file.binary, order=file.order)
        files.append(values.path)
        width = 3 if item.kind.startswith("vector") else 1
        label = f"{values.path}: parcel field {item.name}"
        values.text()
        numbers = values.floats(width * count, a_line=6).reshape(count, width)
        if not values.done:
            raise values.fail(f"continues after the values of {count} parcels")
        for letter, part in zip("XYZ" if width == 3 else [""], numbers.T, strict=True):
            columns[field_name + (f"_{letter}" if letter else "")] = Column(label, part)
    return mapped_cloud(name, str(path), position, columns, names), files
