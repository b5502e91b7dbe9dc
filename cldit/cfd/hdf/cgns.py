"""CGNS in HDF5: zones, their cells, and fields in cells or at vertices.

Layout after the CGNS standard (SIDS and its HDF5 mapping), read through h5py: vtk's reader of CGNS
makes coordinates single precision, and ends the process on a damaged file. The format has no
parcels: a mapping file names their table (`parcels.file`).
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.case import CfdCase, Column, Listing, refuse_cloud
from cldit.cfd.hdf.arrays import arrays_in, bytes_of, hdf_files, open_hdf
from cldit.cfd.inputs import regular
from cldit.cfd.mapping.file import ColumnMap
from cldit.cfd.mesh.cells import Labels
from cldit.cfd.mesh.elements import ElementMesh, block_corners
from cldit.cfd.mesh_parts import MeshPart, join_gas
from cldit.cfd.size import Size, check_room
from cldit.cfd.times import CaseTime, choose_time
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
# ElementType_t: vtk's type, and the order of its corners; surfaces and lines are omitted
_WEDGE = (0, 2, 1, 3, 5, 4)  # its first triangle points inwards in CGNS, outwards in vtk
_CELLS = {10: (10, range(4)), 12: (14, range(5)), 14: (13, _WEDGE), 17: (12, range(8))}
_SURFACES = range(2, 10)
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
    several = len(zones) > 1
    found = join_gas(path, zones, names.cells, spec.fuel_field, CGNS_NAMES, several=several)
    return replace(found, time_s=at, files=hdf_files(path))


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
    found = []
    for name, base in children(root, "CGNSBase_t"):
        if data_of(path, base).tolist() != [3, 3]:
            raise SprayError(f"{path}: {name}: is not three-dimensional")
        found += children(base, "Zone_t")
    if not found:
        raise SprayError(f"{path}: no zone in it")
    return found


def _time(path: Path, root: Any, wanted: CaseTime | None) -> float | None:
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
    if not times and wanted not in (None, "latest"):
        raise SprayError(f"{path}: does not state its time; remove spray.time_s")
    return choose_time(str(path), times, wanted) if times else None


def _size(path: Path, root: Any) -> Size:
    """Estimate from the sizes of the zones and the shapes of all arrays."""
    sizes = [data_of(path, zone) for _, zone in _zones(path, root)]
    cells = sum(int(np.prod(each[1], dtype=np.int64)) for each in sizes if len(each) == 3)
    return Size(cells, 0, 2.0 * bytes_of(arrays_in(root)))


def _zone(path: Path, zone: Any) -> MeshPart:
    name = zone.name.rpartition("/")[2]
    sizes = data_of(path, zone)
    if sizes.ndim != 2 or sizes.shape[0] != 3 or sizes.dtype.kind not in "iu" or sizes.min() < 0:
        raise SprayError(f"{path}: {name}: sizes of shape {sizes.shape}, expected three rows")
    kinds = [text_of_node(path, each) for _, each in children(zone, "ZoneType_t")]
    vertices, cells = (int(np.prod(row, dtype=np.int64)) for row in sizes[:2])
    grids = children(zone, "GridCoordinates_t")
    if not grids:
        raise SprayError(f"{path}: {name}: no coordinates")
    arrays = dict(_arrays(path, grids[0][1], vertices))
    if missing := {"CoordinateX", "CoordinateY", "CoordinateZ"} - set(arrays):
        raise SprayError(f"{path}: {name}: {min(missing)} is missing; expected: X, Y, Z")
    points = np.stack([arrays[f"Coordinate{letter}"] for letter in "XYZ"], axis=1)
    if kinds == ["Structured"]:
        kind, nodes, ends = _blocks(path, name, sizes)
    else:
        kind, nodes, ends = _elements(path, zone)
    if len(kind) != cells:
        raise SprayError(f"{path}: {name}: {len(kind)} cells of a volume, expected {cells}")
    mesh = ElementMesh(points.astype(np.float64), kind, ends, nodes, f"{path}: {name}")
    fields: tuple[dict[str, Column], dict[str, Column]] = ({}, {})
    for _, solution in children(zone, "FlowSolution_t"):
        where = [text_of_node(path, each) for _, each in children(solution, "GridLocation_t")]
        place = {"CellCenter": 0, "Vertex": 1}.get(where[0] if where else "Vertex")
        if place is None:
            raise SprayError(f"{path}: {solution.name}: fields at {where[0]} are not read; {_WAY}")
        for key, values in _arrays(path, solution, (cells, vertices)[place]):
            if key in fields[place]:
                raise SprayError(f"{path}: {name}: {key} twice, of several times; {_WAY}")
            fields[place][key] = Column(f"{path}: {name}: field {key}", values)
    return MeshPart(f"{path}: {name}", lambda: mesh, *fields)


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


def _elements(path: Path, zone: Any) -> tuple[NDArray[np.uint8], Labels, Labels]:
    """Type, corners and offsets of the cells of an unstructured zone, in order."""
    found: list[tuple[int, NDArray[np.uint8], Labels, Labels]] = []
    for name, part in children(zone, "Elements_t"):
        kind = int(data_of(path, part).reshape(-1)[0])
        if kind in _SURFACES:
            continue
        nodes_of = [*children(part, "DataArray_t"), *children(part, "IndexRange_t")]
        known = {key: data_of(path, each).reshape(-1) for key, each in nodes_of}
        if kind not in _CELLS or not {"ElementConnectivity", "ElementRange"} <= set(known):
            raise SprayError(
                f"{path}: {name}: elements of type {kind}; allowed: tetrahedra, pyramids, "
                f"wedges and hexahedra, each kind in a section of its own; {_WAY}"
            )
        first, last = known["ElementRange"].tolist()
        vtk, order = _CELLS[kind]
        nodes = known["ElementConnectivity"]
        if nodes.dtype.kind not in "iu" or len(nodes) != (last - first + 1) * len(order):
            what = f"{len(nodes)} corners for elements {first} to {last} of {len(order)}"
            raise SprayError(f"{path}: {name}: {what}")
        turned = nodes.reshape(-1, len(order))[:, list(order)].astype(np.int64) - 1
        kinds, counts = np.full(len(turned), vtk, np.uint8), np.full(len(turned), len(order))
        found.append((first, kinds, turned.reshape(-1), counts))
    found.sort(key=lambda each: each[0])
    if not found:
        raise SprayError(f"{path}: {zone.name}: has no cells")
    kinds, nodes, counts = (np.concatenate([each[k] for each in found]) for k in (1, 2, 3))
    return kinds.astype(np.uint8), nodes, np.concatenate([[0], np.cumsum(counts)])


def open_cgns(path: Path) -> AbstractContextManager[Any]:
    """Opens a file, which must be in HDF5."""
    with open_regular(regular(path)) as stream:
        if stream.read(8) != b"\x89HDF\r\n\x1a\n":
            raise SprayError(
                f"{path}: CGNS in ADF, or damaged; allowed: CGNS in HDF5 (convert it with adf2hdf)"
            )
    return open_hdf(path)


def children(group: Any, label: str) -> list[tuple[str, Any]]:
    """Names and groups of the nodes with a `label` such as `Zone_t`, ordered by name."""
    return [(name, each) for name, each in sorted(group.items()) if _label(each) == label]


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
    found: list[Any] = []
    root.visititems(lambda _, each: found.append(each) if _label(each) else None)
    for node in found:
        if _label(node) == "DimensionalUnits_t":
            text = data_of(path, node).astype(np.uint8).tobytes().decode("latin-1")
            names = {text[place : place + 32].strip("\0 ") for place in range(0, len(text), 32)}
            if odd := names - _SI:
                raise SprayError(f"{path}: {node.name}: is in {min(odd)}; expected: SI")
        elif _label(node) == "DataClass_t":
            kind = text_of_node(path, node)
            if kind not in ("Dimensional", "UserDefined"):
                raise SprayError(f"{path}: {node.name}: {kind}; expected: dimensional data in SI")
