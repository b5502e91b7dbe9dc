"""CGNS in HDF5: zones, their cells, and fields in cells or at vertices.

Layout after the CGNS standard (SIDS and its HDF5 mapping), read through h5py: vtk's reader of CGNS
makes coordinates single precision, and ends the process on a damaged file. The format has no
parcels: a mapping file names their table (`parcels.file`).
"""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.cfd.case import CaseTime, CfdCase, Column, Listing, refuse_cloud, stated_time
from cldit.cfd.hdf.arrays import arrays_in, bytes_of, hdf_files, nodes_in, open_hdf
from cldit.cfd.inputs import Size, check_room, regular
from cldit.cfd.mapping.columns import MeshPart, join_gas
from cldit.cfd.mapping.file import SI_UNITS, ColumnMap
from cldit.cfd.mesh.cells import Labels
from cldit.cfd.mesh.elements import ElementMesh, block_corners
from cldit.cfd.mesh.faces import Mesh, mesh_of_sides
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray

# SIDS (CGNS Standard Interface Data Structures), annex A
CGNS_NAMES = {
    "temperature": ("Temperature",),
    "pressure": ("Pressure",),
    "density": ("Density",),
    "fuel": ("{}",),
}
# ElementType_t: vtk's type, and the order of its corners; surfaces and lines are omitted. The first
# triangle of a wedge points inwards in CGNS, outwards in vtk.
_CELLS: dict[int, tuple[int, Sequence[int]]] = {
    10: (10, range(4)), 12: (14, range(5)), 14: (13, (0, 2, 1, 3, 5, 4)), 17: (12, range(8))
}  # fmt: skip
_SURFACES = {2: 1, 3: 2, 4: 3, 5: 3, 6: 6, 7: 4, 8: 8, 9: 9}  # corners of points, lines, faces
_MIXED, _NGON, _NFACE = 20, 22, 23
_SI = {"Kilogram", "Meter", "Second", "Kelvin", "Radian", "Degree", "Null", "UserDefined", ""}
_WAY = "open it in ParaView and save the gas as .vtu"


def read_cgns(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads a file of one time."""
    path = spec.file
    refuse_cloud(spec)
    with open_cgns(path) as root:
        check_units(path, root)
        at = _time(path, root, spec.time_s)
        check_room(path, _size(path, root))
        watch("reading the zones", 0, 1)
        zones = [_zone(path, zone) for _, zone in _zones(path, root)]
    files = hdf_files(path)
    for file in files[1:]:
        with open_cgns(file) as root:
            check_units(file, root)
    gas = join_gas(path, zones, names.cells, spec.fuel_field, CGNS_NAMES)
    return replace(gas, time_s=at, files=files)


def list_cgns(spec: CfdSpray) -> Listing:
    """Lists times [s] and fields of a file."""
    path = spec.file
    with open_cgns(path) as root:
        at = _time(path, root, None)
        fields = {
            name
            for _, zone in _zones(path, root)
            for _, solution in children(zone, "FlowSolution_t")
            for name, _ in children(solution, "DataArray_t")
        }
    return ([] if at is None else [at]), sorted(fields), {}


def _zones(path: Path, root: Any) -> list[tuple[str, Any]]:
    zones = []
    for name, base in children(root, "CGNSBase_t"):
        if data_of(path, base).tolist() != [3, 3]:
            raise SprayError(f"{path}: {name}: is not three-dimensional")
        zones += children(base, "Zone_t")
    if not zones:
        raise SprayError(f"{path}: no zone in it")
    return zones


def _time(path: Path, root: Any, requested: CaseTime | None) -> float | None:
    times = [
        float(value)
        for _, base in children(root, "CGNSBase_t")
        for _, steps in children(base, "BaseIterativeData_t")
        for name, array in children(steps, "DataArray_t")
        if name == "TimeValues"
        for value in data_of(path, array).reshape(-1)
    ]
    if len(set(times)) > 1:
        raise SprayError(f"{path}: {len(set(times))} times in it; export one: {_WAY}")
    return stated_time(str(path), times, requested)


def _size(path: Path, root: Any) -> Size:
    """Estimate from the sizes of the zones and the shapes of all arrays."""
    sizes = [data_of(path, zone) for _, zone in _zones(path, root)]
    cells = sum(int(np.prod(size[1], dtype=np.int64)) for size in sizes if len(size) == 3)
    return Size(cells, 0, 2.0 * bytes_of(arrays_in(root)))


def _zone(path: Path, zone: Any) -> MeshPart:
    name = zone.name.rpartition("/")[2]
    sizes = data_of(path, zone)
    if sizes.ndim != 2 or sizes.shape[0] != 3 or sizes.dtype.kind not in "iu" or sizes.min() < 0:
        raise SprayError(f"{path}: {name}: sizes of shape {sizes.shape}, expected three rows")
    kinds = [text_of_node(path, node) for _, node in children(zone, "ZoneType_t")]
    vertices, cells = (int(np.prod(row, dtype=np.int64)) for row in sizes[:2])
    grids = children(zone, "GridCoordinates_t")
    if len(grids) != 1:
        held = (
            f"{len(grids)} sets of coordinates, of a mesh that moves" if grids else "no coordinates"
        )
        raise SprayError(f"{path}: {name}: {held}; {_WAY}")
    arrays = dict(_arrays(path, grids[0][1], vertices))
    if missing := {"CoordinateX", "CoordinateY", "CoordinateZ"} - set(arrays):
        raise SprayError(f"{path}: {name}: {min(missing)} is missing; expected: X, Y, Z")
    points = np.stack([arrays[f"Coordinate{letter}"] for letter in "XYZ"], axis=1)
    source, places = f"{path}: {name}", points.astype(np.float64)
    mesh: ElementMesh | Mesh
    sections = _sections(path, zone)
    if any(section.kind == _NFACE for section in sections):
        mesh = _polyhedra(places, sections, source)
    else:
        structured = kinds == ["Structured"]
        kind, nodes, ends = _blocks(path, name, sizes) if structured else _elements(sections)
        mesh = ElementMesh(places, kind, ends, nodes, source)
    if mesh.cells != cells:
        raise SprayError(f"{path}: {name}: {mesh.cells} cells of a volume, expected {cells}")
    fields: tuple[dict[str, Column], dict[str, Column]] = ({}, {})
    for _, solution in children(zone, "FlowSolution_t"):
        where = [text_of_node(path, node) for _, node in children(solution, "GridLocation_t")]
        place = {"CellCenter": 0, "Vertex": 1}.get(where[0] if where else "Vertex")
        if place is None:
            raise SprayError(f"{path}: {solution.name}: fields at {where[0]} are not read; {_WAY}")
        for key, values in _arrays(path, solution, (cells, vertices)[place]):
            if key in fields[place]:
                raise SprayError(f"{path}: {name}: {key} twice, of several times; {_WAY}")
            unit = _unit(path, dict(children(solution, "DataArray_t"))[key])
            fields[place][key] = Column(f"{path}: {name}: field {key}", values, unit=unit)
    return MeshPart(f"{path}: {name}", mesh, *fields)


def _unit(path: Path, array: Any) -> str | None:
    """Unit by the exponents of kilogram, metre, second, kelvin and degree, if they are given."""
    for _, exponents in children(array, "DimensionalExponents_t"):
        return SI_UNITS.get(tuple(powers := data_of(path, exponents).tolist()), str(powers))
    return None


def _arrays(path: Path, group: Any, count: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Names and values (N,) of the arrays in a group, without rind."""
    for _, rind in children(group, "Rind_t"):
        if np.any(data_of(path, rind)):
            raise SprayError(f"{path}: {group.name}: has ghost cells (Rind), not read; {_WAY}")
    for name, array in children(group, "DataArray_t"):
        values = data_of(path, array).reshape(-1)
        if values.dtype.kind not in "fiu" or len(values) != count:
            raise SprayError(f"{path}: {array.name}: {len(values)} values, expected {count}")
        yield name, values


def _blocks(path: Path, name: str, sizes: NDArray[Any]) -> tuple[NDArray[np.uint8], Labels, Labels]:
    """Type, corners and offsets of the cells of a structured zone."""
    if sizes.shape != (3, 3) or sizes[0].min() < 2 or np.any(sizes[1] != sizes[0] - 1):
        raise SprayError(f"{path}: {name}: sizes {sizes.tolist()} do not form a block")
    nodes = block_corners(sizes[0])
    return np.full(len(nodes), 12, np.uint8), nodes.reshape(-1), np.arange(0, nodes.size + 1, 8)


@dataclass(frozen=True)
class _Section:
    """Section of elements from number `first` on; offsets of each in `nodes`, if it states them."""

    label: str
    kind: int
    first: int
    count: int
    nodes: Labels
    offsets: Labels | None

    def fail(self, problem: str) -> SprayError:
        return SprayError(f"{self.label}: {problem}; {_WAY}")

    def lists(self) -> tuple[Labels, Labels]:
        """Numbers of all elements of several, and where each begins, (N + 1,)."""
        begin = self.offsets
        if begin is None or len(begin) != self.count + 1 or np.any(np.diff(begin) < 1):
            raise self.fail("no ElementStartOffset that fits (CGNS 3.4 and later have it)")
        if begin[0] != 0 or begin[-1] != len(self.nodes):
            raise self.fail(f"offsets {begin[0]} to {begin[-1]} of {len(self.nodes)} numbers")
        return self.nodes, begin


def _sections(path: Path, zone: Any) -> list[_Section]:
    """Sections of an unstructured zone in the order of their elements, without surfaces."""
    sections = []
    for name, part in children(zone, "Elements_t"):
        kind = int(data_of(path, part).reshape(-1)[0])
        if kind in _SURFACES:
            continue
        label = f"{path}: {name}"
        nodes_of = [*children(part, "DataArray_t"), *children(part, "IndexRange_t")]
        arrays = {key: data_of(path, array).reshape(-1) for key, array in nodes_of}
        if kind not in (*_CELLS, _MIXED, _NGON, _NFACE):
            allowed = "tetrahedra, pyramids, wedges, hexahedra, MIXED, NGON_n with NFACE_n"
            raise SprayError(f"{label}: elements of type {kind}; allowed: {allowed}; {_WAY}")
        if lacking := {"ElementConnectivity", "ElementRange"} - set(arrays):
            raise SprayError(f"{label}: no {min(lacking)}")
        low, high = arrays["ElementRange"].tolist()
        nodes = arrays["ElementConnectivity"]
        if nodes.dtype.kind not in "iu":
            raise SprayError(f"{label}: corners that are no whole numbers")
        head = label, kind, low, high - low + 1, nodes.astype(np.int64)
        sections.append(_Section(*head, arrays.get("ElementStartOffset")))
    return sorted(sections, key=lambda section: section.first)


def _elements(sections: list[_Section]) -> tuple[NDArray[np.uint8], Labels, Labels]:
    """Type, corners and offsets of the cells of an unstructured zone, in order."""
    parts = [(np.empty(0, np.uint8), np.empty(0, np.int64), np.empty(0, np.int64))]
    corners = _SURFACES | {kind: len(order) for kind, (_, order) in _CELLS.items()}
    for part in sections:
        if part.kind == _MIXED:
            numbers, begin = part.lists()
            kinds, begin, sizes = numbers[begin[:-1]], begin[:-1] + 1, np.diff(begin) - 1
        else:
            size = corners.get(part.kind, 0)
            if len(part.nodes) != part.count * size:
                problem = f"{len(part.nodes)} corners for {part.count} elements of {size}"
                raise part.fail(problem)
            kinds, sizes = np.full(part.count, part.kind), np.full(part.count, size)
            begin = np.arange(part.count) * size
        if odd := {int(k) for k in np.unique(kinds) if np.any(sizes[kinds == k] != corners.get(k))}:
            raise part.fail(f"elements of type {min(odd)} with another number of corners")
        solid = np.isin(kinds, list(_CELLS))
        kinds, begin, sizes = kinds[solid], begin[solid], sizes[solid]
        place = np.cumsum(sizes) - sizes
        nodes, types = np.empty(int(sizes.sum()), np.int64), np.empty(len(kinds), np.uint8)
        for kind, (vtk, order) in _CELLS.items():
            of_kind = np.flatnonzero(kinds == kind)
            types[of_kind] = vtk
            turned = part.nodes[begin[of_kind, None] + np.array(order)] - 1
            nodes[place[of_kind, None] + np.arange(len(order))] = turned
        parts.append((types, nodes, sizes))
    types, nodes, sizes = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return types, nodes, np.concatenate([[0], np.cumsum(sizes)])


def _polyhedra(points: Floats, sections: list[_Section], source: str) -> Mesh:
    """Mesh of NFACE_n, of signed numbers of the faces in NGON_n: negative if they point inwards."""
    ngons = [section for section in sections if section.kind == _NGON]
    cells = [section for section in sections if section.kind == _NFACE]
    if len(ngons) + len(cells) != len(sections) or not ngons:
        raise sections[0].fail("polyhedra beside other cells, or without their faces (NGON_n)")
    faces = [section.lists() for section in ngons]
    numbers = np.concatenate([section.first + np.arange(section.count) for section in ngons])
    sizes = np.concatenate([np.diff(begin) for _, begin in faces])
    corners = np.concatenate([nodes for nodes, _ in faces]) - 1
    solids = [section.lists() for section in cells]
    signed = np.concatenate([labels for labels, _ in solids])
    cell = np.repeat(
        np.arange(sum(section.count for section in cells)),
        np.concatenate([np.diff(begin) for _, begin in solids]),
    )
    face = np.minimum(np.searchsorted(numbers, np.abs(signed)), len(numbers) - 1)
    outwards = signed > 0
    sides = np.bincount(face, minlength=len(numbers)), np.bincount(face[outwards])
    if np.any(numbers[face] != np.abs(signed)) or sides[0].max() > 2 or sides[1].max() > 1:
        raise cells[0].fail("a face that does not exist, or belongs to cells in the same sense")
    of_face = np.full((2, len(numbers)), -1)
    of_face[np.where(outwards, 0, 1), face] = cell
    used = of_face.max(axis=0) >= 0
    corners, start = corners[np.repeat(used, sizes)], np.append(0, np.cumsum(sizes[used]))
    return mesh_of_sides(points, corners, start, of_face[:, used], int(cell.max()) + 1, source)


def open_cgns(path: Path) -> AbstractContextManager[Any]:
    """Opens a file, which must be in HDF5."""
    with open_regular(regular(path)) as stream:
        if stream.read(8) != b"\x89HDF\r\n\x1a\n":
            raise SprayError(
                f"{path}: CGNS in ADF, or damaged; allowed: CGNS in HDF5 (convert it with adf2hdf)"
            )
    return open_hdf(path)


def children(group: Any, label: str) -> list[tuple[str, Any]]:
    """Names and groups of the nodes with a `label` such as `Zone_t`, ordered by name.

    A node that links to one of another file is that one.
    """
    nodes = ((name, _linked(node)) for name, node in sorted(group.items()))
    return [(name, node) for name, node in nodes if _label(node) == label]


def _linked(node: Any) -> Any:
    return node[" link"] if hasattr(node, "keys") and " link" in node else node


def _label(node: Any) -> str:
    value = getattr(node, "attrs", {}).get("label", b"")
    return value.decode("latin-1").strip("\0 ") if isinstance(value, bytes) else ""


def data_of(path: Path, node: Any) -> NDArray[Any]:
    """Array (any shape) of a node as it is stored: the last index of CGNS comes first."""
    if " data" not in node:
        raise SprayError(f"{path}: {node.name}: no data")
    return np.asarray(node[" data"][()])


def text_of_node(path: Path, node: Any) -> str:
    """Text of a node of characters."""
    return data_of(path, node).astype(np.uint8).tobytes().decode("latin-1").strip("\0 ")


def check_units(path: Path, root: Any) -> None:
    """Refuses a file in other units than SI, or of data without a dimension."""
    for node in nodes_in(root):
        if _label(node) == "DimensionalUnits_t":
            units = data_of(path, node).astype(np.uint8).tobytes().decode("latin-1")
            names = {units[place : place + 32].strip("\0 ") for place in range(0, len(units), 32)}
            if odd := names - _SI:
                raise SprayError(f"{path}: {node.name}: is in {min(odd)}; expected: SI")
        elif _label(node) == "DataClass_t":
            kind = text_of_node(path, node)
            if kind not in ("Dimensional", "UserDefined"):
                raise SprayError(f"{path}: {node.name}: {kind}; expected: dimensional data in SI")
