"""OpenFOAM cases: ascii, binary or gz, whole, decomposed or collated, with any cloud of parcels.

Read with NumPy instead of vtk's readers, which return float32, and no parcels at all for clouds
with barycentric coordinates only.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cldit.cfd.case import NO_CLOUD, CfdCase, Cloud, Column, Listing, choose_cloud, choose_time
from cldit.cfd.inputs import HEAD_BYTES, Size, check_room
from cldit.cfd.mapping.columns import Fields, MeshPart, join_gas, joined_cloud
from cldit.cfd.mapping.file import PARCEL_NAMES, ColumnMap, columns_of, gas_names, merged
from cldit.cfd.mesh.faces import Mesh
from cldit.cfd.openfoam.cloud import cloud_names, read_cloud
from cldit.cfd.openfoam.dictionaries import (
    case_injectors,
    check_processors,
    cut_boundaries,
    wall_temperature_K,
)
from cldit.cfd.openfoam.file import Root, find_foam, open_foam, read_foam, split_roots
from cldit.cfd.openfoam.lists import faces, internal_field, labels, vectors
from cldit.cfd.openfoam.regions import (
    case_folder,
    find_step,
    refuse_missing_parcels,
    regions,
    time_folders,
)
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray


def read_openfoam(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads one time of a case, see `find_step`."""
    step = find_step(spec)
    folder = step.folder
    check_processors(step.roots, step.region)
    clouds = {name for root in step.roots for name in cloud_names(root.path / folder)}
    if not clouds and spec.cloud != NO_CLOUD:
        refuse_missing_parcels(step)
    chosen = choose_cloud(str(step.place), clouds, spec.cloud)
    available = sorted({name for root in step.roots for name in _file_names(root.path / folder)})
    mapped = gas_names(names.cells, available, spec.fuel_field)
    fields = len(columns_of(mapped) & set(available))
    places = [root.path / "constant" / step.region / "polyMesh" for root in step.roots]
    check_room(step.case, foam_size(places, fields=fields))
    read: dict[Path, float | None] = {}
    meshes: list[tuple[Root, Mesh]] = []
    for number, root in enumerate(step.roots):
        watch("reading the mesh", number, len(step.roots))
        part = _mesh(root, step.time, step.region, read)
        if part is not None:
            meshes.append((root, part))
    if not meshes:
        raise SprayError(f"{step.case}: the mesh has no cell")

    def field(root: Root, mesh: Mesh, name: str) -> Column:
        watch(f"reading {name}", 0, 1)
        file = root.path / folder / name
        field_file = read_foam(file, root.block)
        values, unit = internal_field(field_file, mesh.cells)
        read[field_file.path] = field_file.time_s
        return Column(root.label(file), values, unit=unit)

    parts = [
        MeshPart(str(step.place), mesh, Fields(available, partial(field, root, mesh)))
        for root, mesh in meshes
    ]
    gas = join_gas(step.place, parts, names.cells, spec.fuel_field)
    injectors, dictionaries = case_injectors(step.case, chosen, step.region)
    boundaries, lists = cut_boundaries(meshes, step.region)
    parcels = None if chosen is None else _cloud(chosen, meshes, folder, names, read)
    return replace(
        gas,
        time_s=step.time,
        cloud=parcels,
        injectors=injectors,
        boundaries=boundaries,
        wall_K=wall_temperature_K(meshes[0][0], step.region, folder),
        files=(*read, *lists, *dictionaries),
        remarks=step.remarks,
        times_s={file: t for file, t in read.items() if t is not None} | {step.place: step.time},
    )


def list_openfoam(spec: CfdSpray) -> Listing:
    """Lists times [s], cell fields (`region/field` if there are regions), clouds with fields."""
    case = case_folder(spec.file)
    roots = [case, *dict.fromkeys(root.path for root in split_roots(case))]
    by_time: dict[float, list[Path]] = {}
    for root in roots:
        for time, folders in time_folders(root).items():
            by_time.setdefault(time, []).extend(folders)
    fields: set[str] = set()
    clouds: dict[str, set[str]] = {}
    for folder in by_time[choose_time(str(case), by_time, spec.time_s)]:
        for name in [spec.region] if spec.region is not None else regions(case):
            place = folder / name
            if not place.is_dir():
                continue
            fields |= {str(Path(name) / field) for field in _file_names(place)}
            for cloud in cloud_names(place):
                clouds.setdefault(cloud, set()).update(_file_names(place / "lagrangian" / cloud))
    return list(by_time), sorted(fields), {name: sorted(names) for name, names in clouds.items()}


def _file_names(folder: Path) -> set[str]:
    return {file.name.removesuffix(".gz") for file in folder.glob("*") if file.is_file()}


def _mesh(part: Root, time_s: float, region: str, read: dict[Path, float | None]) -> Mesh | None:
    """Mesh at a time: each file from the latest folder up to that time that has it.

    None for a processor without cells. The files are added to `read`, without a time: the mesh of
    an earlier one is valid.
    """
    root, block = part.path, part.block
    by_time = time_folders(root)
    earlier = sorted((time for time in by_time if time <= time_s), reverse=True)
    folders = [folder / region / "polyMesh" for time in earlier for folder in by_time[time]]
    folders.append(root / "constant" / region / "polyMesh")

    def latest(name: str) -> Path:
        candidates = (folder / name for folder in folders if find_foam(folder / name) is not None)
        path = next(candidates, folders[-1] / name)
        read[find_foam(path) or path] = None
        return path

    points = vectors(read_foam(latest("points"), block))
    corners, start = faces(read_foam(latest("faces"), block))
    owner = labels(read_foam(latest("owner"), block))
    inner = labels(read_foam(latest("neighbour"), block))
    if not len(owner) and not len(points):
        return None
    if len(inner) > len(owner):
        raise SprayError(f"{folders[-1]}: {len(inner)} neighbours for {len(owner)} owners")
    neighbour = np.full(len(owner), -1, dtype=np.int32)
    neighbour[: len(inner)] = inner
    cells = int(max(owner.max(initial=-1), inner.max(initial=-1))) + 1
    return Mesh(points, corners, start, owner, neighbour, cells, str(latest("faces").parent))


def _cloud(
    name: str,
    meshes: Sequence[tuple[Root, Mesh]],
    folder: str,
    names: ColumnMap,
    read: dict[Path, float | None],
) -> Cloud:
    """Cloud of all processors; those that the spray has not reached have no folder for it."""
    columns = columns_of(merged(names.parcels, PARCEL_NAMES))
    parts = [
        read_cloud(place, mesh, root.block, columns=columns, read=read)
        for root, mesh in meshes
        if (place := root.path / folder / "lagrangian" / name).is_dir()
    ]
    source = str(Path(parts[0][0].label).parent)
    return joined_cloud(name, source, parts, names, columns)


_NOTE = re.compile(rb"nPoints:\s*(\d+)\s+nCells:\s*(\d+)\s+nFaces:\s*(\d+)")
_COUNT = re.compile(rb"^\s*(\d+)\s*\(", re.MULTILINE)


def foam_size(meshes: Sequence[Path], *, fields: int) -> Size:
    """Estimate for the meshes of all processors, and a number of cell fields."""
    total, largest, held = 0, 0.0, 0.0
    for folder in meshes:
        points, cells, faces = _counts(folder / "owner")
        # a face: four corners, where it begins, two cells, and its sides; a cell: where it begins
        held += 24 * points + (4 * 4 + 4 + 8 + 8) * faces + (8 + 8 * fields) * cells
        if (stored := find_foam(folder / "faces")) is not None:
            largest = max(largest, _unpacked_bytes(stored))
        total += cells
    return Size(total, 0, held + 1.5 * largest)


def _unpacked_bytes(path: Path) -> int:
    """Size of a file's content; a .gz ends with it (RFC 1952: modulo 2^32)."""
    size = path.stat().st_size
    if path.suffix != ".gz" or size < 4:
        return size
    with open_regular(path) as stream:
        stream.seek(size - 4)
        return max(size, int.from_bytes(stream.read(4), "little"))


def _counts(owner: Path) -> tuple[int, int, int]:
    """Points, cells and faces, from OpenFOAM's note in the file, else from its list's length."""
    path = find_foam(owner)
    if path is None:
        return 0, 0, 0
    try:
        with open_foam(path) as stream:
            head = stream.read(HEAD_BYTES)
    except SprayError:  # the reader reports it
        return 0, 0, 0
    if (note := _NOTE.search(head)) is not None:
        points, cells, faces = map(int, note.groups())
        return points, cells, faces
    count = _COUNT.search(head)
    faces = 0 if count is None else int(count.group(1))
    return faces // 3, faces // 3, faces
