"""HDF5 files of CFD codes: opening them, and checking their arrays."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.inputs import module, regular
from cldit.cfd.mesh.cells import AnyFloats, Labels, narrowed
from cldit.errors import FileError, SprayError
from cldit.io.hdf_files import check_links, check_sources


@contextmanager
def open_hdf(path: Path) -> Iterator[Any]:
    """Opens an HDF5 file; errors while it is read become `SprayError`."""
    h5py = module("h5py", path)
    _check_end(regular(path))
    try:
        with h5py.File(regular(path), "r") as file:
            _referenced(path, file)
            yield file
    except SprayError:
        raise
    except FileError as error:
        raise SprayError(str(error)) from error
    except (OSError, RuntimeError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise SprayError(f"{path}: cannot be read as HDF5: damaged or cut off ({error})") from error


def _check_end(path: Path) -> None:
    """Refuses a file with another length than its superblock states: HDF5 finds missing bytes only.

    Layout after the HDF5 file format specification, "Disk Format: Level 0A".
    """
    with path.open("rb") as stream:
        head = stream.read(64)
    places = {0: (8, 40), 1: (8, 44)}.get(head[8] if len(head) == 64 else -1)
    if len(head) == 64 and head[8] in (2, 3) and head[9] == 8:
        places = 8, 28
    if places is None or not head.startswith(b"\x89HDF\r\n\x1a\n"):
        return
    stated = int.from_bytes(head[places[1] : sum(places)], "little")
    if stated < (size := path.stat().st_size):
        raise SprayError(f"{path}: is damaged: {size} bytes, its head states {stated}")


def unit_of(dataset: Any) -> str | None:
    """Unit in an attribute of an array."""
    unit = next((v for k, v in dataset.attrs.items() if k.lower() in ("unit", "units")), None)
    return unit.decode("latin-1") if isinstance(unit, bytes) else unit


def _referenced(path: Path, file: Any) -> set[Path]:
    """Checked files to which an open one refers, by links or as sources of arrays."""
    linked = check_links(path, file, complete=True)
    return linked.union(*(check_sources(path, array) for array in arrays_in(file)))


def hdf_files(path: Path) -> tuple[Path, ...]:
    """The file, and those to which it refers."""
    with open_hdf(path) as file:
        return (path, *sorted(_referenced(path, file)))


def nodes_in(root: Any) -> list[Any]:
    """All groups and arrays below `root`; links to one already found are not followed."""
    nodes: list[Any] = []
    root.visititems(lambda _, node: nodes.append(node))
    return nodes


def arrays_in(root: Any) -> list[Any]:
    """All arrays."""
    return [node for node in nodes_in(root) if hasattr(node, "dtype")]


def bytes_of(arrays: Iterable[Any]) -> int:
    """Size of arrays once they are unpacked."""
    return sum(int(array.size) * array.dtype.itemsize for array in arrays)


def stored(path: Path, group: Any, name: str, count: int | None = None) -> NDArray[Any]:
    """Numbers (N,) of the array `name`, in the file's type; `count`: its length, if known."""
    if name not in group:
        raise SprayError(f"{path}: {group.name}/{name} is missing")
    values = np.asarray(group[name][()])
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        raise SprayError(f"{path}: {group.name}/{name}: no list of numbers (shape {values.shape})")
    if count is not None and len(values) != count:
        raise SprayError(f"{path}: {group.name}/{name}: {len(values)} values, expected {count}")
    return values


def field(path: Path, group: Any, name: str, count: int | None = None) -> AnyFloats:
    """Numbers (N,) of the array `name`, in the file's precision."""
    values = stored(path, group, name, count)
    return values.astype(values.dtype if values.dtype.kind == "f" else np.float64)


def labels(path: Path, group: Any, name: str, count: int | None = None) -> Labels:
    """Whole numbers (N,) of the array `name`, four bytes each if that is enough."""
    values = stored(path, group, name, count)
    if values.dtype.kind == "f" and not np.all(values == np.rint(values)):
        raise SprayError(f"{path}: {group.name}/{name}: a label is no whole number")
    return narrowed(values)
