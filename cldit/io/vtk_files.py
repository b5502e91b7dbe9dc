"""Cells and points as XML files of VTK (.vtu, .vtp), without the library.

Layout after "VTK XML File Formats" of VTK's documentation.
"""

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.io.files import write_text

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
    encoded = base64.b64encode(np.array([len(data)], dtype="<u8").tobytes() + data).decode("ascii")
    width = values.shape[1] if values.ndim == 2 else 1
    tuple_count = f' NumberOfTuples="{len(values)}"' if tuples else ""
    return (
        f'<DataArray type="{_TYPES[kind]}" Name="{name}" NumberOfComponents="{width}"{tuple_count} '
        f'format="binary">{encoded}</DataArray>'
    )
