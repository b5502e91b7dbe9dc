"""Fluent's case and data in HDF5 (.cas.h5, .dat.h5): polyhedral mesh and cell fields.

Layout after vtk's reader of such files (vtkFLUENTCFFReader), read through h5py. These files have no
particles: a mapping file names their table (`parcels.file`).
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.case import CfdCase, Column, Listing, refuse_cloud, stated_time
from cldit.cfd.hdf.arrays import field, hdf_files, labels, open_hdf, stored
from cldit.cfd.inputs import Size, check_room
from cldit.cfd.mapping.columns import Fields, MeshPart, join_gas
from cldit.cfd.mapping.file import ColumnMap
from cldit.cfd.mesh.faces import Mesh, mesh_of_sides
from cldit.errors import SprayError
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray

ENDINGS = (".cas.h5", ".dat.h5")
# SV_P is relative to the operating pressure, which is no field.
FLUENT_NAMES = {"temperature": ("SV_T",), "density": ("SV_DENSITY",), "fuel": ("{}",)}
_UNREAD = {
    "special/Overset_DCI": "an overset mesh",
    "meshes/1/cells/tree": "an adapted mesh with hanging nodes",
    "meshes/1/faces/interface": "a mesh with interfaces",
}
_WAY = "in Fluent, File > Export > EnSight Case Gold"
_MESH, _CELLS = "meshes/1", "results/1/phase-1/cells"


def is_fluent(path: Path) -> bool:
    """True for the name of one of Fluent's pair of files."""
    return path.name.lower().endswith(ENDINGS)


def read_fluent(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads the pair NAME.cas.h5 and NAME.dat.h5, of which the scene names one."""
    path = spec.file
    stated_time(str(path), (), spec.time_s)
    refuse_cloud(spec)
    case, data = pair(path)
    with open_hdf(case) as file:
        mesh_group = _group(case, file, _MESH)
        for name, feature in _UNREAD.items():
            if name in file:
                raise SprayError(f"{case}: {feature} ({name}), which is not read; {_WAY}")
        cells = _count(case, mesh_group, "cellCount")
        faces, nodes = (_count(case, mesh_group, name) for name in ("faceCount", "nodeCount"))
        check_room(case, Size(cells, 0, (4 * 12 + 44) * faces + 24 * nodes + 40 * cells))
        watch("reading the mesh", 0, 1)
        mesh = _mesh(case, mesh_group, cells)
    with open_hdf(data) as file:
        groups = sorted(_group(data, file, "results/1"))
        if phases := [name for name in groups if re.fullmatch(r"phase-(?!1$)\d+", name)]:
            raise SprayError(f"{data}: {', '.join(phases)} in addition to phase-1; {_WAY}")
        held = _group(data, file, _CELLS)
        fields = _fields(held)

        def read(name: str) -> Column:
            watch(f"reading {name}", 0, 1)
            return Column(f"{data}: cell field {name}", _field(data, held[name], cells))

        part = MeshPart(str(data), mesh, Fields(fields, read))
        gas = join_gas(data, [part], names.cells, spec.fuel_field, FLUENT_NAMES)
    return replace(gas, files=(*hdf_files(case), *hdf_files(data)))


def list_fluent(spec: CfdSpray) -> Listing:
    """Lists the cell fields of a pair."""
    _, data = pair(spec.file)
    with open_hdf(data) as file:
        return [], _fields(_group(data, file, _CELLS)), {}


def pair(path: Path) -> tuple[Path, Path]:
    """Paths of case and data, of which `path` is one."""
    stem = re.sub(r"\.(cas|dat)\.h5$", "", path.name, flags=re.IGNORECASE)
    by_name = {entry.name.lower(): entry for entry in path.parent.iterdir()}
    files = [by_name.get(f"{stem.lower()}{ending}") for ending in ENDINGS]
    for ending, file in zip(ENDINGS, files, strict=True):
        if file is None:
            hint = "Fluent's case and data are read together"
            raise SprayError(f"{path}: {stem}{ending} is missing; {hint}")
    case, data = files
    assert case is not None and data is not None
    return case, data


def _fields(cells: Any) -> list[str]:
    """Names of fields, which are groups of sections; a text with their names lies beside them."""
    return sorted(name for name in cells if hasattr(cells[name], "keys"))


def _group(path: Path, file: Any, name: str) -> Any:
    if name not in file:
        raise SprayError(f"{path}: no {name} in it: not this kind of Fluent's files, or two phases")
    return file[name]


def _count(path: Path, group: Any, name: str) -> int:
    count = int(np.asarray(group.attrs[name]).reshape(-1)[0]) if name in group.attrs else 0
    if count < 1:
        raise SprayError(f"{path}: {group.name}: {name} is {count}, expected a number above 0")
    return count


def _sections(path: Path, group: Any) -> list[tuple[int, int, Any]]:
    """First and last index (from 1) of each section of ids, and its group."""
    parts = [group[name] for name in sorted(group) if name.isdigit()]
    sections = [(_count(path, part, "minId"), _count(path, part, "maxId"), part) for part in parts]
    return sorted(sections, key=lambda section: section[:2])


def _in_order(path: Path, group: Any, count: int) -> list[tuple[int, int, Any]]:
    """Sections that cover 1 to `count` once."""
    sections = _sections(path, group)
    begins, ends = [low - 1 for low, _, _ in sections], [high for _, high, _ in sections]
    if [*begins, count] != [0, *ends]:
        raise SprayError(f"{path}: {group.name}: its sections do not cover 1..{count} once")
    return sections


def _field(path: Path, group: Any, count: int) -> NDArray[Any]:
    sections = _in_order(path, group, count)
    keys = [(section.name.rpartition("/")[2], high - low + 1) for low, high, section in sections]
    parts = [field(path, group, *key) for key in keys]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _mesh(path: Path, group: Any, cells: int) -> Mesh:
    """Mesh of faces between cells c0 and c1, from 1; 0 is none, as is a missing section of c1.

    Normals point into c0.
    """
    faces, nodes = (_count(path, group, name) for name in ("faceCount", "nodeCount"))
    held = _group(path, group, "nodes/coords")
    points = []
    for low, high, part in _in_order(path, held, nodes):
        values = np.asarray(part[()])
        if values.shape != (high - low + 1, 3) or values.dtype.kind != "f":
            raise SprayError(f"{path}: {part.name}: shape {values.shape}, expected (N, 3): 3D only")
        points.append(values)
    sizes, corners = [], []
    held = _group(path, group, "faces/nodes")
    for low, high, part in _in_order(path, held, faces):
        sizes.append(labels(path, part, "nnodes", high - low + 1))
        corners.append(labels(path, part, "nodes", int(sizes[-1].sum())))
    start = np.concatenate([[0], np.cumsum(np.concatenate(sizes))])
    corner = np.concatenate(corners) - 1
    sides = np.zeros((2, faces), np.int64)
    for number, name in enumerate(("c0", "c1")):
        held = _group(path, group, f"faces/{name}")
        for low, high, part in _sections(path, held):
            key = part.name.rpartition("/")[2]
            if high > faces:
                raise SprayError(f"{path}: {part.name}: goes to face {high} of {faces}")
            sides[number, low - 1 : high] = stored(path, held, key, high - low + 1)
    point = np.concatenate(points).astype(np.float64)
    if np.any(sides < 0) or np.any(sides > cells) or np.any(sides.sum(axis=0) == 0):
        raise SprayError(f"{path}: {group.name}/faces: a face lies between cells that do not exist")
    return mesh_of_sides(point, corner, start, sides[::-1] - 1, cells, str(path))
