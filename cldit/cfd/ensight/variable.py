"""EnSight variables: values per element and per node, also undefined and partial ones."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.ensight.file import Reader
from cldit.cfd.mesh import Labels, Mesh
from cldit.spray.result import Floats


@dataclass
class Part:
    """A part of the geometry: where its nodes and its elements are in the mesh.

    first_node, nodes: of its points in the mesh's. elements: type, number, and the cell of each
    element, (many,), -1 for those that are no cells (flat, ghost, blanked).
    """

    first_node: int
    nodes: int
    elements: list[tuple[str, int, Labels]] = field(default_factory=list)


Parts = dict[int, Part]


def per_element(file: Reader, parts: Parts, cells: int, label: str) -> Column:
    """A field (cells,) in the order of the mesh; values that the file leaves out are undefined.

    Raises:
        SprayError: the file is damaged, or does not fit the geometry.
    """
    values, state = (
        np.zeros(cells),
        np.zeros(cells, dtype=np.int8),
    )  # 0 missed, 1 given, 2 undefined
    file.text()
    line = "" if file.done else file.text()
    while line == "part":
        part = _part(file, parts)
        line = "" if file.done else file.text()
        for kind, many, place in part.elements:
            name, _, mode = line.partition(" ")
            if name != kind:
                continue  # a type may be left out; if it holds cells, they are missed below
            found, defined = _values(file, many, mode.strip())
            kept = place >= 0
            values[place[kept]] = found[kept]
            state[place[kept]] = np.where(defined[kept], 1, 2)
            line = "" if file.done else file.text()
    if line:
        raise file.fail(f"{line!r} where a part or its elements are expected")
    if missed := int(np.sum(state == 0)):
        raise file.fail(f"no value for {missed} of {cells} cells; truncated?")
    return Column(label, values, state == 2)


def per_node(file: Reader, parts: Parts, points: int, label: str) -> Column:
    """A field (points,) at the points of the mesh; what the file leaves out is undefined."""
    values, undefined = np.zeros(points), np.ones(points, dtype=bool)
    file.text()
    line = "" if file.done else file.text()
    while line == "part":
        part = _part(file, parts)
        name, _, mode = file.text().partition(" ")
        if name not in ("coordinates", "block"):
            raise file.fail(f"{name!r}, expected `coordinates` or `block`")
        found, defined = _values(file, part.nodes, mode.strip())
        here = slice(part.first_node, part.first_node + part.nodes)
        values[here], undefined[here] = found, ~defined
        line = "" if file.done else file.text()
    if line:
        raise file.fail(f"{line!r} where a part is expected")
    return Column(label, values, undefined)


def _part(file: Reader, parts: Parts) -> Part:
    number = int(file.integers(1)[0])
    if number not in parts:
        raise file.fail(f"part {number} is not in the geometry")
    return parts[number]


def _values(file: Reader, many: int, mode: str) -> tuple[Floats, Labels]:
    """Values (many,), and whether each is defined."""
    if mode == "undef":
        mark = file.floats(1)[0]
        found = file.floats(many)
        return found, np.asarray(found != mark)
    if mode == "partial":
        count = int(file.integers(1)[0])
        place = file.integers(count) - 1
        if count and (place.min() < 0 or place.max() >= many or len(set(place.tolist())) < count):
            raise file.fail(f"partial values for elements outside 1..{many}, or twice for one")
        values, defined = np.zeros(many), np.zeros(many, dtype=bool)
        values[place], defined[place] = file.floats(count), True
        return values, defined
    if mode:
        raise file.fail(f"values of kind {mode!r}; allowed are plain, `undef` and `partial` ones")
    return file.floats(many), np.ones(many, dtype=bool)


def corner_mean(mesh: Mesh, values: Floats) -> Floats:
    """Mean of values at points (P,) over the distinct corners of each cell, (N,)."""
    size = np.diff(mesh.start)
    points = len(mesh.points_m)
    pairs = np.repeat(mesh.owner, size) * points + mesh.corners
    inner = np.flatnonzero(np.repeat(mesh.neighbour, size) >= 0)
    others = np.repeat(mesh.neighbour, size)[inner] * points + mesh.corners[inner]
    cell, point = np.divmod(np.unique(np.concatenate([pairs, others])), points)
    total = np.bincount(cell, weights=values[point], minlength=mesh.cells)
    return np.asarray(total / np.bincount(cell, minlength=mesh.cells))
