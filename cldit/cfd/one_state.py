"""One state of a case: every cell and every parcel once, and a single time."""

import re
from collections.abc import Iterable

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import CfdCase, Cloud, Column, triple
from cldit.cfd.mesh.cells import Boxes, CellMesh, Labels
from cldit.cfd.mesh.elements import BoxMesh
from cldit.cfd.mesh.faces import JoinedMesh
from cldit.errors import SprayError

_TIMES = set(
    "time times timevalue timestep timeindex step iteration cycle flowtime physicaltime "
    "solutiontime simulationtime integrationtime".split()
)
_IDENTITIES = set("particleid parcelid dropletid trackid particleidentifier".split())
_NEAR = 1e-3  # of the smallest edge; centroids of distinct cells are farther apart
_SLACK = 1e-3  # of the volume of the box around a mesh


def _plain(name: str) -> str:
    """Letters and digits of a column's name without a unit."""
    return re.sub(r"[^a-z0-9]", "", re.sub(r"[\[(].*", "", name.lower()))


def _shown(value: object) -> str:
    return f"{value:.15g}" if isinstance(value, float) else str(value)


def is_mark(name: str) -> bool:
    """True for the name of a column that gives the time, or the identity of a particle."""
    return _plain(name) in _TIMES | _IDENTITIES


def check_marks(marks: Iterable[Column], names: Iterable[str]) -> None:
    """Refuses rows of several times, and rows that give a particle more than once.

    `marks` are columns (N,) of numbers or texts whose `names` satisfy `is_mark`.
    """
    for column, name in zip(marks, names, strict=True):
        if column.values.ndim != 1 or not len(column.values):
            continue
        found, counts = np.unique(column.values, return_counts=True)
        if _plain(name) in _TIMES and len(found) > 1:
            raise SprayError(
                f"{column.label}: has {len(found)} values, from {_shown(found[0])} to "
                f"{_shown(found[-1])}; "
                "allowed: one time; keep the rows of one time"
            )
        if _plain(name) in _IDENTITIES and counts.max() > 1:
            often = int(np.argmax(counts))
            raise SprayError(
                f"{column.label}: {_shown(found[often])} occurs {counts[often]} times, so the rows "
                "are tracks, or files put together twice; allowed: each particle once, at one time"
            )


def check_parcels_once(cloud: Cloud) -> None:
    """Refuses a cloud in which two parcels have equal place, size, and velocity and age if given.

    Parcels of age zero are ignored: several may leave one place.
    """
    known = [cloud.position_m, *(cloud.fields[n] for n in ("d", "U", "age") if n in cloud.fields)]
    rows = np.column_stack([np.asarray(each.values, np.float64) for each in known])
    rows = rows + 0.0  # a negative zero becomes zero
    at = np.arange(len(rows))
    if "age" in cloud.fields:
        at = np.flatnonzero(cloud.fields["age"].values > 0.0)
    first, same = _equal_rows(rows[at])
    if len(same):
        raise SprayError(
            f"{cloud.position_m.label}: {len(same)} of {len(rows)} parcels occur twice, such as "
            f"parcels {at[first[0]]} and {at[same[0]]} at {triple(rows[at[same[0]], :3])} m; "
            "allowed: each parcel once (export without the overlap of processors)"
        )


def _equal_rows(rows: Floats) -> tuple[Labels, Labels]:
    """Pairs of equal rows (N, M): indices of the first, and of each further one.

    Rows are compared where hashes of them are equal: sorting numbers is much faster.
    """
    key = np.zeros(len(rows), np.uint64)
    for part in np.ascontiguousarray(rows).view(np.uint64).T:
        key = (key ^ part) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    order = np.argsort(key, kind="stable")
    at = np.flatnonzero(key[order][1:] == key[order][:-1])
    first, second = order[at], order[at + 1]
    equal = np.flatnonzero(np.all(rows[first] == rows[second], axis=1))
    equal = equal[np.argsort(second[equal])]
    return first[equal], second[equal]


def check_cells_once(case: CfdCase, cells: Labels, box: Boxes) -> None:
    """Refuses boxes (N,) of the cells `cells` (N,) of which two have one centroid."""
    if len(cells) < 2:
        return
    edges = box.upper_m - box.lower_m
    step = _NEAR * max(float(edges.min()), 1e-12)
    # an irrational shift: centroids of regular grids do not lie between two places
    places = np.floor((box.lower_m + box.upper_m) / (2.0 * step) + np.sqrt(0.5))
    first, same = _equal_rows(places)
    if not len(same):
        return
    one, other = int(cells[first[0]]), int(cells[same[0]])
    here, there = _part_of(case.mesh, one), _part_of(case.mesh, other)
    where = f"those of {here}" if here != there else "others of the same file"
    raise SprayError(
        f"{there}: {len(same)} cells with fuel lie where {where} do, such as cells {one} and "
        f"{other} of the case at {triple(box.lower_m[same[0]] / 2 + box.upper_m[same[0]] / 2)} m; "
        "allowed: each cell once (export without ghost cells, or mark them by vtkGhostType)"
    )


def check_volume(mesh: CellMesh, volume_m3: float) -> None:
    """Refuses cells that are larger together than the box around all of them."""
    low, high = mesh.extent_m
    around = float(np.prod(high - low))
    if not isinstance(mesh, BoxMesh) and volume_m3 > (1.0 + _SLACK) * around:
        raise SprayError(
            f"{mesh.source}: the cells have {volume_m3:.4g} m3 together, the box around them "
            f"{around:.4g} m3, so some overlap; allowed: each place in one cell (export without "
            "ghost cells and without coarse cells below finer ones)"
        )


def _part_of(mesh: CellMesh, cell: int) -> str:
    """Source of the part of a mesh to which a cell belongs."""
    if not isinstance(mesh, JoinedMesh):
        return mesh.source
    for part in mesh.parts:
        if cell < part.cells:
            return part.source
        cell -= part.cells
    return mesh.source
