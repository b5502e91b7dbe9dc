"""CONVERGE's post files: HDF5 groups, their arrays, and the mesh of a stream."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.cell_mesh import AnyFloats, Labels, narrowed
from cldit.cfd.inputs import regular
from cldit.cfd.mesh import Mesh
from cldit.errors import SprayError
from cldit.spray.result import Floats


@contextmanager
def open_post(path: Path) -> Iterator[Any]:
    """The HDF5 file.

    Raises:
        SprayError: h5py is not installed; the file is missing, damaged, or cut off.
    """
    try:
        import h5py
    except ImportError as error:
        raise SprayError(
            f'{path}: reading it needs h5py; install it with: pip install "cldit[cfd]"'
        ) from error
    try:
        with h5py.File(regular(path), "r") as file:
            yield file
    except SprayError:
        raise
    except (OSError, RuntimeError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise SprayError(f"{path}: cannot be read as HDF5: damaged or cut off ({error})") from error


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
    with open_post(path) as file:
        value = np.asarray(file.attrs.get("OUTPUT_TIME", [])).reshape(-1)
    return float(value[0]) if len(value) else None


def array(path: Path, group: Any, name: str, count: int | None = None) -> Floats:
    """(N,) numbers of an array, as doubles.

    Args:
        path: named by errors.
        group: of the file.
        name: of the array in it.
        count: its length, if it is known.

    Raises:
        SprayError: it is missing, no list of numbers, or of another length.
    """
    return _stored(path, group, name, count).astype(np.float64)


def _stored(path: Path, group: Any, name: str, count: int | None) -> NDArray[np.generic]:
    if name not in group:
        raise SprayError(f"{path}: {group.name}/{name} is missing")
    values = np.asarray(group[name][()])
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        raise SprayError(f"{path}: {group.name}/{name}: no list of numbers (shape {values.shape})")
    if count is not None and len(values) != count:
        raise SprayError(f"{path}: {group.name}/{name}: {len(values)} values, expected {count}")
    return values


def field(path: Path, group: Any, name: str, count: int) -> AnyFloats:
    """As `array`, (N,), as exact as it is stored.

    Args:
        path: named by errors.
        group: of the file.
        name: of the array in it.
        count: its length.

    Raises:
        SprayError: it is missing, no list of numbers, or of another length.
    """
    values = _stored(path, group, name, count)
    return values.astype(values.dtype if values.dtype.kind == "f" else np.float64)


def labels(path: Path, group: Any, name: str, count: int | None = None) -> Labels:
    """As `array`, (N,), of whole numbers, four bytes each where that is enough.

    Args:
        path: named by errors.
        group: of the file.
        name: of the array in it.
        count: its length, if it is known.

    Raises:
        SprayError: it is missing, no list of whole numbers, or of another length.
    """
    values = _stored(path, group, name, count)
    if values.dtype.kind == "f" and not np.all(values == np.rint(values)):
        raise SprayError(f"{path}: {group.name}/{name}: holds a label that is no whole number")
    return narrowed(values)


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
