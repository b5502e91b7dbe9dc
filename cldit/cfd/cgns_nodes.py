"""Nodes of a CGNS file in HDF5: groups with a label, and their data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.hdf import open_hdf
from cldit.cfd.inputs import regular
from cldit.errors import SprayError

_SI = {"Kilogram", "Meter", "Second", "Kelvin", "Radian", "Degree", "Null", "UserDefined", ""}


@contextmanager
def open_cgns(path: Path) -> Iterator[Any]:
    """The root of a file.

    Raises:
        SprayError: as `open_hdf`; or it is in ADF.
    """
    with regular(path).open("rb") as stream:
        if stream.read(8) != b"\x89HDF\r\n\x1a\n":
            raise SprayError(
                f"{path}: is CGNS in ADF, or damaged; CGNS in HDF5 is read: convert it with adf2hdf"
            )
    with open_hdf(path) as root:
        yield root


def children(group: Any, label: str) -> list[tuple[str, Any]]:
    """Nodes of a label.

    Args:
        group: in which they are.
        label: of CGNS, as `Zone_t`.

    Returns:
        Names and groups, in the order of the names.
    """
    return [(name, each) for name, each in sorted(group.items()) if _label(each) == label]


def _label(node: Any) -> str:
    value = getattr(node, "attrs", {}).get("label", b"")
    return value.decode("latin-1").strip("\0 ") if isinstance(value, bytes) else ""


def data_of(path: Path, node: Any) -> NDArray[Any]:
    """What a node holds.

    Args:
        path: named by errors.
        node: a group.

    Returns:
        The array (any shape) as it is stored: the last index of CGNS comes first.

    Raises:
        SprayError: it holds nothing.
    """
    if " data" not in node:
        raise SprayError(f"{path}: {node.name}: holds no data")
    return np.asarray(node[" data"][()])


def text_of_node(path: Path, node: Any) -> str:
    """What a node of characters says.

    Args:
        path: named by errors.
        node: a group.

    Raises:
        SprayError: it holds nothing.
    """
    return data_of(path, node).astype(np.uint8).tobytes().decode("latin-1").strip("\0 ")


def check_units(path: Path, root: Any) -> None:
    """Refuses a file that says that it is not in SI.

    Args:
        path: named by errors.
        root: of the file.

    Raises:
        SprayError: a node names another unit, or data without a dimension.
    """
    found: list[Any] = []
    root.visititems(lambda _, each: found.append(each) if _label(each) else None)
    for node in found:
        if _label(node) == "DimensionalUnits_t":
            text = data_of(path, node).astype(np.uint8).tobytes().decode("latin-1")
            names = {text[place : place + 32].strip("\0 ") for place in range(0, len(text), 32)}
            if odd := names - _SI:
                raise SprayError(f"{path}: {node.name}: is in {min(odd)}; expected is SI")
        elif _label(node) == "DataClass_t" and text_of_node(path, node) not in (
            "Dimensional",
            "UserDefined",
        ):
            said = text_of_node(path, node)
            raise SprayError(f"{path}: {node.name}: {said}; expected are dimensional data, in SI")
