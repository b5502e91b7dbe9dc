"""CONVERGE's post files: their times, and the mesh of a stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.hdf import array, labels, open_hdf
from cldit.cfd.mesh import Mesh
from cldit.errors import SprayError


def post_files(path: Path) -> list[Path]:
    """The file, or all .h5 files of a folder.

    Raises:
        SprayError: the folder has none.
    """
    found = sorted(path.glob("*.h5")) if path.is_dir() else [path]
    if not found:
        raise SprayError(f"{path}: holds no .h5 file")
    return found


def time_of(path: Path) -> float | None:
    """OUTPUT_TIME of a file, s, if it states it."""
    with open_hdf(path) as file:
        value = np.asarray(file.attrs.get("OUTPUT_TIME", [])).reshape(-1)
    return float(value[0]) if len(value) else None


def post_mesh(path: Path, stream: Any) -> Mesh:
    """The mesh of a stream.

    Args:
        path: named by errors.
        stream: its group in the file.

    Raises:
        SprayError: an array is missing, or does not fit the others.
    """
    x = array(path, stream, "VERTEX_COORDINATES/X")
    y, z = (array(path, stream, f"VERTEX_COORDINATES/{name}", len(x)) for name in "YZ")
    start = labels(path, stream, "CONNECTIVITY/POLYGON_OFFSET")
    corners = labels(path, stream, "CONNECTIVITY/POLYGON_TO_VERTEX")
    cells = labels(path, stream, "CONNECTIVITY/CONNECTED_CELLS", 2 * max(len(start) - 1, 0))
    sides = cells.reshape(-1, 2)
    if not len(sides) or start[0] != 0 or start[-1] != len(corners) or np.diff(start).min() < 3:
        raise SprayError(f"{path}: {stream.name}/CONNECTIVITY/POLYGON_OFFSET does not fit its mesh")
    first, second = sides.T
    if np.any((first < 0) & (second < 0)):
        raise SprayError(f"{path}: {stream.name}/CONNECTIVITY/CONNECTED_CELLS: a face of no cell")
    # a negative cell is a boundary; a face belongs to its first cell, else, turned, to the second
    turned = np.flatnonzero(first < 0)
    size = start[turned + 1] - start[turned]
    step = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
    begin = np.repeat(start[turned], size)
    corners[begin + step] = corners[begin + np.repeat(size, size) - 1 - step]
    return Mesh(
        points_m=np.stack([x, y, z], axis=1),
        corners=corners,
        start=start,
        owner=np.where(first < 0, second, first),
        neighbour=np.where((first < 0) | (second < 0), np.int32(-1), second),
        cells=int(sides.max()) + 1,
        source=f"{path}: {stream.name}",
    )
