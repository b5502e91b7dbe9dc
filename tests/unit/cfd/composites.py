"""Files of several data sets: VTK's HDF by vtk's own writer, CGNS by h5py after its standard."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.unit.cfd.conftest import Form, write_case
from tests.unit.cfd.formats.conftest import WRITERS
from tests.unit.cfd.formats.test_amrex import Plot
from tests.unit.cfd.formats.test_fluent import MAPPING, write_dpm, write_fluent
from tests.unit.cfd.vtkfiles import block_grid, cloud_data, save


def write_hdf(file: Path, blocks: dict[str, Any]) -> Path:
    """By vtk's writer: one data set as it is, several as a collection; a list is partitions."""
    from vtkmodules.vtkCommonDataModel import (
        vtkCompositeDataSet,
        vtkPartitionedDataSet,
        vtkPartitionedDataSetCollection,
    )
    from vtkmodules.vtkIOHDF import vtkHDFWriter

    data: Any = next(iter(blocks.values()))
    if len(blocks) > 1 or isinstance(data, list):
        data = vtkPartitionedDataSetCollection()
        for number, (name, parts) in enumerate(blocks.items()):
            own: Any = vtkPartitionedDataSet()
            for place, part in enumerate(parts if isinstance(parts, list) else [parts]):
                own.SetPartition(place, part)
            data.SetPartitionedDataSet(number, own)
            data.GetMetaData(number).Set(vtkCompositeDataSet.NAME(), name)
    writer: Any = vtkHDFWriter()
    writer.SetFileName(str(file))
    writer.SetInputData(data)
    writer.Write()
    return file


def write_hdf_steps(file: Path, sample: Any, times: list[float]) -> Path:
    """A mesh that stays, and fields for each time, as "Temporal data" of VTK's documentation."""
    block, gas, _ = sample
    nodes = block.hexahedra.reshape(-1)
    cells, points = block.cells, len(block.points)
    with h5py.File(file, "w") as root:
        held = root.create_group("VTKHDF")
        held.attrs["Version"] = np.array([2, 0])
        held.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        for name, count in (("Points", points), ("Cells", cells), ("ConnectivityIds", len(nodes))):
            held[f"NumberOf{name}"] = np.array([count])
        held["Points"] = block.points
        held["Connectivity"], held["Offsets"] = nodes, np.arange(0, 8 * cells + 1, 8)
        held["Types"] = np.full(cells, 12, "u1")
        steps = held.create_group("Steps")
        steps.attrs["NSteps"] = len(times)
        steps["Values"] = np.array(times)
        nothing = np.zeros(len(times), int)
        for name in ("PartOffsets", "PointOffsets"):
            steps[name] = nothing
        steps["NumberOfParts"] = nothing + 1
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = nothing[:, None]
        for name, values in gas.items():
            scale = np.arange(1, len(times) + 1) if name == "C7H16" else np.ones(len(times))
            held[f"CellData/{name}"] = (
                (values * scale[:, None] / len(times)).reshape(-1)
                if (name == "C7H16")
                else np.tile(values, len(times))
            )
            steps[f"CellDataOffsets/{name}"] = np.arange(len(times)) * cells
    return file


def write_cgns(file: Path, sample: Any, *, points: bool = False) -> Path:
    """Hexahedra in one zone, fields in cells or at points, under the names of the standard."""
    block, gas, _ = sample
    nodes = block.hexahedra.reshape(-1)
    names = {"T": "Temperature", "p": "Pressure", "rho": "Density"}
    fields = {
        names.get(name, name): np.full(len(block.points), values.mean()) if points else values
        for name, values in gas.items()
    }
    return _zone(file, 17, block.points, nodes, block.cells, fields, points=points)


def write_elements(file: Path, kind: int, corners: Any) -> Path:
    """One element of a CGNS type by its corners in order."""
    fields = {"Temperature": np.array([500.0]), "Density": np.array([8.0])}
    fields["C7H16"] = np.array([0.1])
    return _zone(file, kind, corners, np.arange(len(corners)), 1, fields, points=False)


_FORMS = {"f8": "R8", "f4": "R4", "i4": "I4"}


def node(parent: Any, name: str, label: str, data: Any = None, form: str = "MT") -> Any:
    """Node of CGNS: a group with attributes, and its data, of a text or an array."""
    made, values = parent.create_group(name, track_order=True), None
    if isinstance(data, str):
        form, values = "C1", np.frombuffer(data.encode(), "i1")
    elif data is not None:
        values = np.asarray(data)
        values = values.astype("i4") if values.dtype.kind == "i" else values
        form = _FORMS[values.dtype.str[1:]]
    for key, text, size in (("name", name, 33), ("label", label, 33), ("type", form, 3)):
        made.attrs.create(key, np.bytes_(text.encode()), dtype=f"S{size}")
    made.attrs["flags"] = np.array([1], "i4")
    if values is not None:
        made[" data"] = values
    return made


def _zone(
    file: Path, kind: int, places: Any, nodes: Any, cells: int, fields: Any, *, points: bool
) -> Path:
    with h5py.File(file, "w", track_order=True) as root:
        for key, text, size in (
            ("name", "HDF5 MotherNode", 33),
            ("label", "Root Node of HDF5 File", 33),
            ("type", "MT", 3),
        ):
            root.attrs.create(key, np.bytes_(text.encode()), dtype=f"S{size}")
        root[" format"] = np.frombuffer(b"IEEE_LITTLE_32\0", "i1")
        root[" hdf5version"] = np.frombuffer(b"HDF5 Version 1.8.17".ljust(33, b"\0"), "i1")
        node(root, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([3.3], "f4"))
        base = node(root, "Base", "CGNSBase_t", [3, 3])
        zone = node(base, "Zone", "Zone_t", np.array([[len(places)], [cells], [0]]))
        node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        held = node(zone, "GridCoordinates", "GridCoordinates_t")
        for letter, column in zip("XYZ", places.T, strict=True):
            node(held, f"Coordinate{letter}", "DataArray_t", column.astype("f8"))
        part = node(zone, "Hexahedra", "Elements_t", [kind, 0])
        node(part, "ElementRange", "IndexRange_t", [1, cells])
        node(part, "ElementConnectivity", "DataArray_t", nodes + 1)
        solution = node(zone, "Solution", "FlowSolution_t")
        node(solution, "GridLocation", "GridLocation_t", "Vertex" if points else "CellCenter")
        for name, values in fields.items():
            node(solution, name, "DataArray_t", np.asarray(values, "f8"))
    return file


ZONE = "Base/Zone"


def section(zone: Any, name: str, kind: int, first: int, lists: list[Any]) -> Any:
    """Elements of lists of numbers, and their offsets."""
    part = node(zone, name, "Elements_t", [kind, 0])
    node(part, "ElementRange", "IndexRange_t", [first, first + len(lists) - 1])
    node(part, "ElementConnectivity", "DataArray_t", np.concatenate(lists))
    node(part, "ElementStartOffset", "DataArray_t", np.cumsum([0, *map(len, lists)]))
    return part


def polyhedra(zone: Any, block: Any) -> None:
    """Faces in two sections, the boundary first; every third is reversed, with its sign."""
    inner = len(block.neighbour)
    order = [*range(inner, len(block.owner)), *range(inner)]
    signed: list[list[int]] = [[] for _ in range(block.cells)]
    faces = []
    for number, face in enumerate(order, start=1):
        sign = -1 if number % 3 == 0 else 1
        faces.append([corner + 1 for corner in block.faces[face][::sign]])
        signed[block.owner[face]].append(sign * number)
        if face < inner:
            signed[block.neighbour[face]].append(-sign * number)
    outer = len(block.owner) - inner
    section(zone, "A", 22, 1, faces[:outer])
    section(zone, "B", 22, outer + 1, faces[outer:])
    section(zone, "C", 23, len(order) + 1, signed)


def mixed(zone: Any, hexahedra: Any) -> None:
    """A square between hexahedra, which is no cell."""
    rows = [[17, *row] for row in hexahedra]
    section(zone, "A", 20, 1, [*rows[:5], [7, *hexahedra[0][:4]], *rows[5:]])


def with_sections(path: Path, block: Any, kind: str) -> Path:
    """The same cells as polyhedra, as MIXED elements, or as a structured zone."""
    with h5py.File(path, "a") as file:
        zone = file[ZONE]
        rows = zone["Hexahedra/ElementConnectivity/ data"][()].reshape(-1, 8)
        del zone["Hexahedra"]
        if kind == "polyhedra":
            polyhedra(zone, block)
        elif kind == "structured":
            shape = np.array(block.shape) + 1
            del zone[" data"], zone["ZoneType/ data"]
            zone[" data"] = np.array([shape, shape - 1, [0, 0, 0]], "i4")
            zone["ZoneType/ data"] = np.frombuffer(b"Structured", "i1")
        else:
            mixed(zone, rows)
    return path


def with_checksums(file: Path) -> Path:
    """The same file of HDF5, of which each chunk is packed and has a checksum."""
    sound = file.with_name(f"unpacked-{file.name}")
    file.rename(sound)
    with h5py.File(sound, "r+") as old:
        arrays: list[str] = []
        old.visititems(lambda name, node: arrays.append(name) if node_is_array(node) else None)
        for name in arrays:
            values = old[name][()]
            del old[name]
            old.create_dataset(name, data=values, compression="gzip", fletcher32=True)
        with h5py.File(file, "w") as new:
            old.copy("VTKHDF", new)  # without what was deleted
    sound.unlink()
    return file


def node_is_array(node: Any) -> bool:
    return isinstance(node, h5py.Dataset) and node.size > 0 and node.ndim > 0


def write_format(kind: str, folder: Path, sample: Any) -> Path:
    """The sample in any format, and what names it as a case."""
    block, gas, cloud = sample
    if kind in WRITERS:
        return WRITERS[kind][0](folder, sample)
    if kind.startswith("openfoam"):
        wide = kind.endswith("label64")
        form = Form(wide or kind.endswith("binary"), kind.endswith("gz"), label=64 if wide else 32)
        place = "coordinates" if kind.endswith("barycentric") else ""
        return write_case(folder, block, gas=gas, cloud=cloud, form=form, barycentric=place)
    folder.mkdir(parents=True, exist_ok=True)
    if kind == "amrex":
        (folder / "names.yaml").write_text("parcels: {density: 684}")
        return Plot().write(folder)
    if kind == "vtm":
        return folder / "all.vtm"
    if kind == "vtkhdf-steps":
        return write_hdf_steps(folder / "a.vtkhdf", sample, [0.0005, 0.001])
    if kind.startswith("vtk") and "hdf" not in kind:
        legacy = ".vtk" if kind.endswith("legacy") else ""
        save(folder / f"gas{legacy or '.vtu'}", block_grid(block, gas))
        save(folder / f"spray{legacy or '.vtp'}", cloud_data(cloud))
        return folder
    if kind.startswith("fluent"):
        if kind == "fluent-dpm":
            write_dpm(folder / "drops.dpm", cloud)
            (folder / "names.yaml").write_text(MAPPING)
        return write_fluent(folder, sample)
    if kind.startswith("cgns"):
        file = write_cgns(folder / "a.cgns", sample)
        return file if kind == "cgns" else with_sections(file, block, kind.partition("-")[2])
    blocks = {"gas": block_grid(block, gas), "drops": cloud_data(cloud)}
    file = write_hdf(folder / "a.vtkhdf", blocks)
    return file if kind == "vtkhdf-by-vtk" else with_checksums(file)


def keys_of(kind: str, folder: Path) -> dict[str, Any]:
    """Keys of a scene that a format of `write_format` needs beside the case."""
    mapping = {"mapping": folder / "names.yaml"} if kind in ("fluent-dpm", "amrex") else {}
    place = {"nozzle_m": (0.0, 0.0, 0.0), "axis": "+z", "fuel_field": "NC7H16"}
    return mapping | (place if kind == "amrex" else {})
