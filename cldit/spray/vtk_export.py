"""A spray as XML files for ParaView, written without VTK: parcels as .vtp, gas as .vtu."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.files import write_text
from cldit.spray.result import Spray

Array = NDArray[np.generic]

_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
_VOXEL = 11
_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])


def write_vtk(spray: Spray, folder: Path) -> list[Path]:
    """`parcels.vtp` and `gas.vtu` in a folder, of what the spray has; the paths written.

    Positions in m, those of parcels that fill boxes evenly in them; point data diameter_m,
    temperature_K, droplets, mass_kg; cell data vapour_kg_m3, temperature_K.
    """
    written = []
    if (parcels := spray.parcels) is not None:
        count = len(parcels.diameter_m)
        points = {
            "diameter_m": parcels.diameter_m,
            "temperature_K": parcels.temperature_K,
            "droplets": parcels.droplets,
            "mass_kg": parcels.masses_kg,
        }
        at = np.arange(count, dtype=np.int64)
        body = (
            f'<Piece NumberOfPoints="{count}" NumberOfVerts="{count}" NumberOfLines="0" '
            f'NumberOfStrips="0" NumberOfPolys="0">'
            f"<PointData>{_arrays(points)}</PointData>"
            f"<Points>{_array('Points', parcels.points_m())}</Points>"
            f"<Verts>{_array('connectivity', at)}{_array('offsets', at + 1)}</Verts></Piece>"
        )
        written.append(_write(folder / "parcels.vtp", "PolyData", body))
    if (vapour := spray.vapour) is not None:
        cells = vapour.cells
        count = len(cells.lower_m)
        edge = cells.upper_m - cells.lower_m
        corners = (cells.lower_m[:, None] + edge[:, None] * _CORNERS).reshape(-1, 3)
        fields = {
            "vapour_kg_m3": vapour.number_density_m3 * vapour.molar_mass_kg_mol / 6.02214076e23,
            "temperature_K": vapour.temperature_K,
        }
        order = np.arange(8 * count, dtype=np.int64)
        body = (
            f'<Piece NumberOfPoints="{8 * count}" NumberOfCells="{count}">'
            f"<CellData>{_arrays(fields)}</CellData>"
            f"<Points>{_array('Points', corners.astype(np.float32))}</Points>"
            f"<Cells>{_array('connectivity', order)}{_array('offsets', order[7::8] + 1)}"
            f"{_array('types', np.full(count, _VOXEL, dtype=np.uint8))}</Cells></Piece>"
        )
        written.append(_write(folder / "gas.vtu", "UnstructuredGrid", body))
    return written


def _write(path: Path, kind: str, body: str) -> Path:
    write_text(
        path,
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64"><{kind}>{body}</{kind}></VTKFile>\n',
    )
    return path


def _arrays(fields: Mapping[str, Array]) -> str:
    return "".join(_array(name, values) for name, values in fields.items())


def _array(name: str, values: Array) -> str:
    kind = values.dtype.str[1:]
    data = values.astype("<" + kind).tobytes()
    text = base64.b64encode(np.array([len(data)], dtype="<u8").tobytes() + data).decode("ascii")
    width = values.shape[1] if values.ndim == 2 else 1
    return (
        f'<DataArray type="{_TYPES[kind]}" Name="{name}" NumberOfComponents="{width}" '
        f'format="binary">{text}</DataArray>'
    )
