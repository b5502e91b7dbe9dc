"""Cells and points as files of VTK, without the library: XML (.vtu, .vtp), HDF (.vtkhdf).

Layouts after "VTK XML File Formats" and "VTKHDF File Format" of VTK's documentation.
"""

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import FileError
from cldit.io.data_streams import new_hdf
from cldit.io.extras import needed
from cldit.io.files import whole, write_text

Array = NDArray[Any]
VOXEL, HEXAHEDRON = 11, 12
_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


@dataclass(frozen=True)
class Grid:
    """Cells of eight corners.

    points_m (P, 3); nodes (N, 8) into them, in the order of the vtk type `kind`. fields: (N,) by
    name. about: (K,) by name, of the whole data set.
    """

    points_m: Array
    nodes: Array
    kind: int
    fields: Mapping[str, Array]
    about: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Points:
    """points_m (N, 3) with a vertex each; fields: (N,) or (N, 3) by name."""

    points_m: Array
    fields: Mapping[str, Array]
    about: Mapping[str, Array] = field(default_factory=dict)


def write_xml(path: Path, data: Grid | Points) -> None:
    """Writes a .vtu of a grid or a .vtp of points; the file appears whole or not at all."""
    about = f"<FieldData>{_arrays(data.about, tuples=True)}</FieldData>" if data.about else ""
    points = f"<Points>{_array('Points', data.points_m)}</Points>"
    if isinstance(data, Grid):
        kind, count = "UnstructuredGrid", len(data.nodes)
        ends = np.arange(8, 8 * count + 8, 8)
        body = (
            f'<Piece NumberOfPoints="{len(data.points_m)}" NumberOfCells="{count}">'
            f"<CellData>{_arrays(data.fields)}</CellData>{points}"
            f"<Cells>{_array('connectivity', data.nodes.reshape(-1))}{_array('offsets', ends)}"
            f"{_array('types', np.full(count, data.kind, np.uint8))}</Cells></Piece>"
        )
    else:
        kind, count = "PolyData", len(data.points_m)
        at = np.arange(count)
        body = (
            f'<Piece NumberOfPoints="{count}" NumberOfVerts="{count}" NumberOfLines="0" '
            f'NumberOfStrips="0" NumberOfPolys="0">'
            f"<PointData>{_arrays(data.fields)}</PointData>{points}"
            f"<Verts>{_array('connectivity', at)}{_array('offsets', at + 1)}</Verts></Piece>"
        )
    write_text(
        path,
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64"><{kind}>{about}{body}</{kind}></VTKFile>\n',
    )


def _arrays(fields: Mapping[str, Array], *, tuples: bool = False) -> str:
    return "".join(_array(name, values, tuples=tuples) for name, values in fields.items())


def _array(name: str, values: Array, *, tuples: bool = False) -> str:
    kind = values.dtype.str[1:]
    data = values.astype("<" + kind).tobytes()
    text = base64.b64encode(np.array([len(data)], dtype="<u8").tobytes() + data).decode("ascii")
    width = values.shape[1] if values.ndim == 2 else 1
    many = f' NumberOfTuples="{len(values)}"' if tuples else ""
    return (
        f'<DataArray type="{_TYPES[kind]}" Name="{name}" NumberOfComponents="{width}"{many} '
        f'format="binary">{text}</DataArray>'
    )


def write_vtkhdf(path: Path, blocks: Mapping[str, Grid | Points]) -> None:
    """Writes blocks by name as a partitioned collection; the file appears whole or not at all.

    Raises FileError if h5py is not installed.
    """
    h5py = needed("h5py", extra="export", what=f"{path}:", error=FileError)
    held = [(each.points_m, *each.fields.values()) for each in blocks.values()]
    size = sum(array.nbytes for arrays in held for array in arrays)
    with whole(path, needed_bytes=size) as part, new_hdf(part, h5py) as (file, _):
        root = file.create_group("VTKHDF", track_order=True)
        _kind(root, "PartitionedDataSetCollection")
        names = root.create_group("Assembly", track_order=True)
        for number, (name, data) in enumerate(blocks.items()):
            group = root.create_group(name, track_order=True)
            group.attrs["Index"] = np.int64(number)
            _put(group, data)
            names[name] = h5py.SoftLink(f"/VTKHDF/{name}")


def _kind(group: Any, kind: str) -> None:
    import h5py

    group.attrs["Version"] = np.array([2, 1], np.int64)
    # fixed length, required by VTK's reader
    text = h5py.string_dtype("ascii", len(kind))
    group.attrs.create("Type", kind.encode("ascii"), dtype=text)


def _put(group: Any, data: Grid | Points) -> None:
    def put(parent: Any, name: str, values: Array) -> None:
        packed: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "fletcher32": True}
        if not values.size:
            packed = {}
        parent.create_dataset(name, data=values, **packed)

    def cells(parent: Any, nodes: Array, each: int) -> None:
        count = len(nodes) // each
        put(parent, "NumberOfCells", np.array([count]))
        put(parent, "NumberOfConnectivityIds", np.array([len(nodes)]))
        put(parent, "Connectivity", nodes)
        put(parent, "Offsets", np.arange(0, len(nodes) + each, each))

    grid = isinstance(data, Grid)
    _kind(group, "UnstructuredGrid" if grid else "PolyData")
    put(group, "NumberOfPoints", np.array([len(data.points_m)]))
    put(group, "Points", data.points_m)
    if isinstance(data, Grid):
        cells(group, data.nodes.reshape(-1), 8)
        put(group, "Types", np.full(len(data.nodes), data.kind, np.uint8))
    else:
        cells(group.create_group("Vertices"), np.arange(len(data.points_m)), 1)
        for name in ("Lines", "Polygons", "Strips"):
            cells(group.create_group(name), np.zeros(0, np.int64), 1)
    for name, fields in (
        ("CellData" if grid else "PointData", data.fields),
        ("FieldData", data.about),
    ):
        held = group.create_group(name)
        for key, values in fields.items():
            put(held, key, values)
