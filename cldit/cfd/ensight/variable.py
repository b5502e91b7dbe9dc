"""EnSight variables: values per element and per node, also undefined and partial ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.cfd.case import Column
from cldit.cfd.ensight.file import Reader
from cldit.cfd.mesh.cells import AnyFloats
from cldit.cfd.mesh.elements import ElementMesh
from cldit.cfd.mesh.faces import Mesh


@dataclass(frozen=True)
class Elements:
    """Elements of one type in a row, `count` of them; or the nodes of a part.

    first: cell of the mesh that the first element is; None if they are no cells (flat, ghost).
    kept: mask of those that are not blanked, of the shape (count,); None for all.
    """

    kind: str
    count: int
    first: int | None
    kept: NDArray[np.bool_] | None = None

    @property
    def cells(self) -> int:
        """Number of cells among them."""
        if self.first is None:
            return 0
        return self.count if self.kept is None else int(np.count_nonzero(self.kept))

    def of_cells(self, values: NDArray[Any]) -> NDArray[Any]:
        """Selects the values, of the shape (count,), that belong to cells."""
        return values if self.kept is None else values[self.kept]


Parts = dict[int, list[Elements]]
"""Parts of a geometry by number: their nodes among those of all parts, then their elements."""
Block = tuple[ElementMesh | Mesh, int]
"""Cells of one part and type, and the index of their first point among those of all parts."""


def read_variable(file: Reader, parts: Parts, count: int, label: str, *, at_nodes: bool) -> Column:
    """Field (count,) at all nodes or in all cells; nodes without a value are undefined."""
    values: AnyFloats = np.zeros(count, np.float64 if at_nodes else np.float32)
    missed, undefined = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    file.text()
    line = file.text(end=True)
    while line == "part":
        number = int(file.integers(1)[0])
        if number not in parts:
            raise file.fail(f"part {number} is not in the geometry")
        line = file.text(end=True)
        for elements in parts[number][:1] if at_nodes else parts[number][1:]:
            name, _, mode = line.partition(" ")
            if name != elements.kind:
                continue  # a type may be missing; if it has cells, an error follows below
            numbers, defined = _values(file, elements.count, mode.strip())
            if elements.first is not None:
                place = slice(elements.first, elements.first + elements.cells)
                values[place] = elements.of_cells(numbers)
                missed[place] = False
                undefined[place] = ~elements.of_cells(defined)
            line = file.text(end=True)
    if line:
        location = "nodes" if at_nodes else "elements"
        raise file.fail(f"{line!r} where a part or its {location} are expected")
    if missed.any() and not at_nodes:
        raise file.fail(f"no value for {int(missed.sum())} of {count} cells; truncated?")
    undefined |= missed
    return Column(label, values, undefined if undefined.any() else None)


def _values(file: Reader, size: int, mode: str) -> tuple[AnyFloats, NDArray[np.bool_]]:
    """Values (size,), and a mask of those that are defined."""
    if mode == "undef":
        mark = file.floats(1)[0]
        numbers = file.floats(size)
        return numbers, np.asarray(numbers != mark)
    if mode == "partial":
        count = int(file.integers(1)[0])
        place = file.integers(count) - 1
        if count and (place.min() < 0 or place.max() >= size or len(set(place.tolist())) < count):
            raise file.fail(f"partial values for elements outside 1..{size}, or twice for one")
        values, defined = np.zeros(size), np.zeros(size, dtype=bool)
        values[place], defined[place] = file.floats(count), True
        return values, defined
    if mode:
        raise file.fail(f"values of kind {mode!r}; allowed: plain, `undef` and `partial`")
    return file.floats(size), np.ones(size, dtype=bool)


def corner_mean(blocks: Sequence[Block], values: AnyFloats) -> Floats:
    """Means (N,) of values (P,) at all parts' points over the distinct corners of each cell."""
    return np.concatenate([_mean(mesh, values[first_node:]) for mesh, first_node in blocks])


def _mean(mesh: ElementMesh | Mesh, values: AnyFloats) -> Floats:
    if isinstance(mesh, ElementMesh):  # of one type
        nodes = np.sort(mesh.nodes.reshape(mesh.cells, -1), axis=1)
        new = np.ones(nodes.shape, dtype=bool)
        new[:, 1:] = nodes[:, 1:] != nodes[:, :-1]
        return np.asarray((values[nodes] * new).sum(axis=1) / new.sum(axis=1))
    return mesh.corner_mean(values)
