"""EnSight Gold cases with measured particles: mesh, fields per element, parcels."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cldit.cfd.case import CfdCase, Cloud, Column, nearest_time
from cldit.cfd.cell_mesh import AnyFloats, CellMesh, Labels
from cldit.cfd.column_mapping import (
    CellColumns,
    ColumnMap,
    ParcelColumns,
    Scalar,
    Source,
    Vector,
    gas_columns,
    mapped_cloud,
    merged,
)
from cldit.cfd.element_mesh import CORNERS, ElementMesh
from cldit.cfd.ensight.file import CaseFile, Item, Reader, read_case_file
from cldit.cfd.mesh import Mesh, join
from cldit.cfd.size import Size, check_room
from cldit.errors import SprayError
from cldit.progress import Watch, silent

_FLAT = {"point": 1, "bar2": 2, "bar3": 3, "tria3": 3, "tria6": 6, "quad4": 4, "quad8": 8}
_VTK = {"tetra4": 10, "pyramid5": 14, "penta6": 13, "hexa8": 12}
_MEASURED = ("scalar per measured node", "vector per measured node")


def read_ensight(
    path: Path,
    *,
    time_s: float | None,
    fuel_field: str,
    cloud: str | None,
    names: ColumnMap,
    watch: Watch = silent,
) -> CfdCase:
    """Reads one time of a case.

    Args:
        path: the .case file, or a folder with one.
        time_s: the latest where None.
        fuel_field: name of the fuel's mass fraction.
        cloud: name of the cloud; None is the only one.
        names: names of fields where they are not T, p, rho, `fuel_field`, and d, nParticle, T, rho,
            U, age for the parcels.
        watch: told how far the work is.

    Raises:
        SprayError: a file is missing or damaged, of a kind that is not read, the time is not
            there, or the case does not fit into memory.
    """
    case = read_case_file(case_path(path))
    cells = merged(names.cells, _gas_names(fuel_field))
    fields = [item for item in case.items if item.kind == "scalar per element"]
    at = nearest_time(str(case.path), times(case), time_s) if times(case) else None
    model = _only(case, "model")
    known_at = _file(case, model, at)
    check_room(known_at, _size(known_at, [_file(case, item, at) for item in fields]))
    watch("reading the mesh", 0, 1)
    geometry = Reader(known_at)
    parts, mesh = _geometry(geometry)
    geometry.close()
    wanted = {getattr(cells, key).column for key in _KEYS if getattr(cells, key) is not None}
    columns = {item.name: Column("", np.empty(0)) for item in fields}
    for item in fields:
        if item.name in wanted:
            watch(f"reading {item.name}", 0, 1)
            file = _file(case, item, at)
            reader = Reader(file, binary=geometry.binary, order=geometry.order)
            label = f"{file}: field {item.name}"
            columns[item.name] = Column(label, _per_element(reader, parts, mesh.cells))
    known = {item.name for item in fields}
    cells = cells.model_copy(
        update={
            key: None
            for key in _KEYS
            # a field that is not there is missed later, by who knows whether it is needed
            if key not in names.cells.model_fields_set and getattr(cells, key).column not in known
        }
    )
    source = Source(str(case.path), columns, mesh.cells)
    return CfdCase(
        source=str(case.path),
        time_s=at,
        mesh=mesh,
        gas=gas_columns(source, cells, fuel_field),
        available=tuple(sorted(known)),
        cloud=_cloud(case, at, cloud, names, geometry),
    )


_KEYS = ("temperature", "pressure", "density", "fuel")


def _gas_names(fuel_field: str) -> CellColumns:
    return CellColumns(
        temperature=Scalar(column="T"),
        pressure=Scalar(column="p"),
        density=Scalar(column="rho"),
        fuel=Scalar(column=fuel_field),
    )


PARCEL_NAMES = ParcelColumns(
    diameter=Scalar(column="d"),
    number=Scalar(column="nParticle"),
    temperature=Scalar(column="T"),
    density=Scalar(column="rho"),
    velocity=Vector(columns=("U_X", "U_Y", "U_Z")),
    age=Scalar(column="age"),
)


def case_path(path: Path) -> Path:
    """The .case file itself, or the only one in a folder.

    Raises:
        SprayError: the folder has none or several.
    """
    if not path.is_dir():
        return path
    found = sorted(path.glob("*.case"))
    if len(found) != 1:
        raise SprayError(f"{path}: holds {len(found)} .case files; give the path of one")
    return found[0]


def times(case: CaseFile) -> list[float]:
    """Times at which any file of the case is written."""
    found = {time for item in case.items for time, _ in case.files(item) if time is not None}
    return sorted(found)


def _only(case: CaseFile, kind: str) -> Item:
    found = [item for item in case.items if item.kind == kind]
    if len(found) != 1:
        raise SprayError(f"{case.path}: GEOMETRY: {len(found)} entries {kind!r}, expected one")
    return found[0]


def _file(case: CaseFile, item: Item, at: float | None) -> Path:
    """The file of an item at a time; a mesh stays what it was."""
    files = case.files(item)
    if files[0][0] is None or at is None:
        return files[-1][1]
    if item.kind == "model":
        before = [(t, f) for t, f in files if t is not None and t <= at * (1 + 1e-9)]
        return max(before or files[:1])[1]
    known = {time: file for time, file in files if time is not None}
    return known[nearest_time(f"{case.path}: {item.name}", known, at)]


Parts = dict[int, list[tuple[str, int, int]]]  # of each part: element type, count, first cell or -1


def _size(geometry: Path, fields: list[Path]) -> Size:
    """By the files' sizes: a number takes four bytes, or a line in ascii, held as an object."""
    try:
        with geometry.open("rb") as stream:
            binary = b"C Binary" in stream.read(84)
        stored = geometry.stat().st_size
        largest = max((file.stat().st_size for file in fields), default=0)
    except OSError:  # who reads the file says what is wrong with it
        return Size(0, 0, 0.0)
    return Size(largest // (4 if binary else 13), 0, (2.5 if binary else 7.0) * stored)


def _geometry(file: Reader) -> tuple[Parts, CellMesh]:
    """The parts with their elements in order, and the mesh of all solid ones."""
    file.text()
    file.text()
    flags = [file.text().split()[-1] for _ in range(2)]
    named_nodes, named_elements = (flag in ("given", "ignore") for flag in flags)
    parts: Parts = {}
    meshes: list[CellMesh] = []
    cells = 0
    line = file.text()
    if line == "extents":
        file.floats(6, a_line=2)
        line = file.text()
    while line == "part":
        number = file.part_number()
        file.text()
        if (kind := file.text()) != "coordinates":
            raise file.fail(f"part {number} is {kind!r}; only unstructured parts are read")
        count = int(file.integers(1)[0])
        if named_nodes:
            file.integers(count)
        points = np.ascontiguousarray(file.floats(3 * count).reshape(3, count).T)
        elements = parts.setdefault(number, [])
        line = "" if file.done else file.text()
        while line not in ("", "part"):
            ghost, kind = line.startswith("g_"), line.removeprefix("g_")
            many = int(file.integers(1)[0])
            if named_elements:
                file.integers(many)
            found = _elements(file, kind, many)
            keep = found is not None and not ghost
            elements.append((line, many, cells if keep else -1))
            if found is not None and keep:
                nodes = found[0]
                if nodes.size and (nodes.min() < 1 or nodes.max() > count):
                    raise file.fail(f"part {number}: {kind} with nodes outside 1..{count}")
                if many:
                    meshes.append(_block(str(file.path), points, kind, many, found))
                cells += many
            line = "" if file.done else file.text()
    if line:
        raise file.fail(f"{line!r} where a part is expected; the file is damaged")
    if not meshes:
        raise file.fail("the mesh has no solid cell")
    return parts, join(meshes)


def _elements(file: Reader, kind: str, many: int) -> tuple[Labels, ...] | None:
    """Nodes of solid elements, from 1; for polyhedra with the faces' sizes, and faces a cell.

    None for flat elements.
    """
    if kind in _FLAT:
        file.integers(many * _FLAT[kind], a_line=_FLAT[kind])
        return None
    if kind == "nsided":
        _ragged(file, file.integers(many))
        return None
    if kind == "nfaced":
        faces = file.integers(many)
        sizes = file.integers(int(faces.sum()))
        return _ragged(file, sizes), sizes, faces
    if kind not in _VTK:
        raise file.fail(f"elements of type {kind!r} are not read; write linear ones")
    corners = CORNERS[_VTK[kind]]
    return (file.integers(many * corners, a_line=corners),)


def _block(
    source: str, points: AnyFloats, kind: str, many: int, found: tuple[Labels, ...]
) -> CellMesh:
    """The mesh of `many` elements of one kind, as `_elements` gives them."""
    nodes = found[0]
    nodes -= 1
    if kind == "nfaced":
        sizes, faces = found[1:]
        start = np.concatenate([[0], np.cumsum(sizes)])
        owner = np.repeat(np.arange(many), faces)
        return Mesh(points, nodes, start, owner, np.full(len(owner), -1), many, source)
    kinds = np.broadcast_to(np.uint8(_VTK[kind]), many)
    return ElementMesh(points, kinds, np.arange(many + 1) * CORNERS[_VTK[kind]], nodes, source)


def _ragged(file: Reader, sizes: Labels) -> Labels:
    if file.binary:
        return file.integers(int(sizes.sum()))
    rows = [file.integers(int(size), a_line=int(size)) for size in sizes]
    return np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)


def _per_element(file: Reader, parts: Parts, cells: int) -> AnyFloats:
    """A field (cells,) in the order of the mesh."""
    file.text()
    values, seen = np.empty(cells, np.float32), np.zeros(cells, dtype=bool)
    line = "" if file.done else file.text()
    while line == "part":
        number = int(file.integers(1)[0])
        if number not in parts:
            raise file.fail(f"part {number} is not in the geometry")
        line = "" if file.done else file.text()
        for kind, many, first in parts[number]:
            if line != kind:
                continue  # a type may be left out; if it holds cells, they are missed below
            found = file.floats(many)
            if first >= 0:
                values[first : first + many] = found
                seen[first : first + many] = True
            line = "" if file.done else file.text()
    if line:
        raise file.fail(f"{line!r} where a part or its elements are expected")
    if not seen.all():
        raise file.fail(f"no value for {int(np.sum(~seen))} of {cells} cells; truncated?")
    return values


def _measured(case: CaseFile) -> Iterator[Item]:
    return (item for item in case.items if item.kind in _MEASURED)


def _cloud(
    case: CaseFile, at: float | None, wanted: str | None, names: ColumnMap, mesh: Reader
) -> Cloud | None:
    geometry = [item for item in case.items if item.kind == "measured"]
    if wanted not in (None, "measured"):
        raise SprayError(f"{case.path}: no cloud {wanted!r} (spray.cloud); there is: measured")
    if not geometry:
        if wanted is not None or any(_measured(case)):
            raise SprayError(f"{case.path}: GEOMETRY: no `measured` file for the parcels")
        return None
    file = Reader(_file(case, geometry[0], at), order=mesh.order)
    file.text()
    if (line := file.text()) != "particle coordinates":
        raise file.fail(f"{line!r}, expected `particle coordinates`")
    count = int(file.integers(1)[0])
    position = Column(f"{file.path}: positions", file.particles(count))
    if not file.done:
        raise file.fail(f"goes on behind its {count} parcels")
    columns: dict[str, Column] = {}
    for item in _measured(case):
        values = Reader(_file(case, item, at), binary=file.binary, order=file.order)
        width = 3 if item.kind.startswith("vector") else 1
        label = f"{values.path}: parcel field {item.name}"
        values.text()
        numbers = values.floats(width * count, a_line=6).reshape(count, width)
        if not values.done:
            raise values.fail(f"goes on behind the values of {count} parcels")
        for letter, part in zip("XYZ" if width == 3 else [""], numbers.T, strict=True):
            columns[item.name + (f"_{letter}" if letter else "")] = Column(label, part)
    return mapped_cloud("measured", str(case.path), position, columns, names, PARCEL_NAMES)
