"""Clouds of an OpenFOAM case, with positions or with barycentric coordinates."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import Column
from cldit.cfd.mesh.cells import Labels
from cldit.cfd.mesh.faces import Mesh
from cldit.cfd.names import species_in
from cldit.cfd.openfoam.file import FoamFile, find_foam, read_foam
from cldit.cfd.openfoam.lists import as_integers, labels, particles, scalars, vectors
from cldit.cfd.tolerances import SLACK, WRITTEN
from cldit.errors import SprayError


def cloud_names(time_folder: Path) -> list[str]:
    """Names of the folders in `lagrangian`."""
    return sorted(folder.name for folder in time_folder.glob("lagrangian/*") if folder.is_dir())


def read_cloud(
    folder: Path,
    mesh: Mesh,
    block: int | None,
    *,
    columns: set[str],
    read: dict[Path, float | None],
) -> tuple[Column, dict[str, Column]]:
    """Positions (N, 3) and fields of one cloud, read from `positions`, else from `coordinates`.

    Both may contain either form. `columns`: names of fields, `U_X` means U; labels and shares of
    species are read, too, if they are readable. Adds the files, and the times that they state, to
    `read`.
    """
    names = ("positions", "coordinates")
    path = next((folder / name for name in names if find_foam(folder / name)), None)
    if path is None:
        held = ", ".join(sorted(entry.name for entry in folder.iterdir())[:8]) or "nothing"
        raise SprayError(
            f"{folder}: the cloud {folder.name!r} has neither positions nor coordinates (but: "
            f"{held}); restore them, choose another (spray.cloud), or spray.cloud: none"
        )
    file = read_foam(path, block)
    rows = particles(file)
    position = rows[:, :3] if rows.shape[1] == 4 else decode(file, rows, mesh)
    if rows.shape[1] == 4:
        _check_cells(file, position, as_integers(file, rows[:, 3]), mesh)
    read[file.path] = file.time_s
    fields: dict[str, Column] = {}
    needed = {*columns, *(re.sub("_[XYZ]$", "", column) for column in columns)}
    stored = {entry.name.removesuffix(".gz") for entry in folder.iterdir() if entry.is_file()}
    for name in sorted((needed & stored) | (stored - set(names))):
        try:
            field = read_foam(folder / name, block)
            share = field.kind == "scalarField" and species_in(name) is not None
            if name not in needed and field.kind != "labelField" and not share:
                continue
            parse: Callable[..., Any] = labels if "label" in field.kind else scalars
            parse = vectors if field.kind.startswith("vector") else parse
            fields[name] = Column(str(folder / name), parse(field, len(position)))
        except SprayError:
            if name in needed:
                raise
            continue
        read[field.path] = field.time_s
    return Column(str(path), position), fields


def _check_cells(file: FoamFile, position_m: Floats, cells: Labels, mesh: Mesh) -> None:
    """Refuses parcels outside the cells that they state, as if the mesh was renumbered since.

    Equal numbers of all parcels, as other programs may write them, state nothing.
    """
    if not len(cells) or cells.min() == cells.max():
        return
    _check_numbers(file, "cell", cells, mesh.cells)
    distinct, at = np.unique(cells, return_inverse=True)
    cell = mesh.measure(distinct)
    slack = WRITTEN * float(np.ptp(np.array(mesh.extent_m), axis=0).max())
    low, high = cell.lower_m[at] - slack, cell.upper_m[at] + slack
    outside = np.any((position_m < low) | (position_m > high), axis=1)
    if 2 * outside.sum() > len(cells):
        bad = int(np.argmax(outside))
        raise file.fail(
            f"{int(outside.sum())} of {len(cells)} parcels lie outside the cells that they state, "
            f"such as parcel {bad} outside cell {cells[bad]}: mesh, fields and parcels have "
            "different numbers of the cells; keep the mesh of this time"
        )


def _check_numbers(file: FoamFile, kind: str, numbers: Labels, end: int) -> None:
    if numbers.size and (numbers.min() < 0 or numbers.max() >= end):
        raise file.fail(f"a parcel in {kind} {numbers.max()}, but the mesh has {end}")


def decode(file: FoamFile, rows: Floats, mesh: Mesh) -> Floats:
    """Positions (N, 3) of parcels in barycentric coordinates.

    rows (N, 7): four coordinates, cell, face, tet point. X = b0 C + b1 P0 + b2 P1 + b3 P2: C the
    cell centre, P0 the base point of the face, P1 and P2 the two face points that follow it by
    `tet point`, in the order in which the face's normal points out of the cell (OpenFOAM,
    tetIndices::faceTriIs). The base point is the first from which no tetrahedron of the face is
    inverted, in the cells on both sides (polyMeshTetDecomposition::findFaceBasePts).
    """
    weights = rows[:, :4]
    cell, face, turn = as_integers(file, rows[:, 4:]).T
    _check_numbers(file, "cell", cell, mesh.cells)
    _check_numbers(file, "face", face, len(mesh.owner))
    size = mesh.start[face + 1] - mesh.start[face]
    owned = mesh.owner[face] == cell
    if not np.all(owned | (mesh.neighbour[face] == cell)):
        bad = int(np.argmin(owned | (mesh.neighbour[face] == cell)))
        raise file.fail(f"parcel {bad}: face {face[bad]} does not belong to cell {cell[bad]}")
    if turn.size and (turn.min() < 1 or np.any(turn > size - 2)):
        bad = int(np.argmax((turn < 1) | (turn > size - 2)))
        raise file.fail(f"parcel {bad}: point {turn[bad]} of a face of {size[bad]} points")
    if np.abs(weights.sum(axis=1) - 1.0).max(initial=0.0) > SLACK:
        raise file.fail("barycentric coordinates that do not sum to one")

    used, back = np.unique(face, return_inverse=True)
    base = _base_points(mesh, used)[back]
    middle, at = _centroids(mesh, cell)
    begin = mesh.start[face]
    second = mesh.corners[begin + (base + turn) % size]
    third = mesh.corners[begin + (base + turn + 1) % size]
    nodes = (
        mesh.corners[begin + base],
        np.where(owned, second, third),
        np.where(owned, third, second),
    )
    corners = [middle[at], *(mesh.points_m[node] for node in nodes)]
    terms = [weights[:, k, None] * corner for k, corner in enumerate(corners)]
    return np.asarray(np.sum(terms, axis=0))


def _centroids(mesh: Mesh, cells: Labels) -> tuple[Floats, Labels]:
    """Centroids of some cells, each once, and the index of that of each of `cells`."""
    distinct, at = np.unique(cells, return_inverse=True)
    return mesh.measure(distinct).centroid_m, at


def _base_points(mesh: Mesh, faces: Labels) -> Labels:
    """Index of the base point among the corners of each of `faces`."""
    begin, size = mesh.start[faces], mesh.start[faces + 1] - mesh.start[faces]
    neighbour = mesh.neighbour[faces]
    # without a neighbour the owner is used, and ignored later
    owner = mesh.owner[faces]
    sides = np.concatenate([owner, np.where(neighbour < 0, owner, neighbour)])
    middle, at = _centroids(mesh, sides)
    owned, beyond = middle[at].reshape(2, -1, 3)
    base = np.zeros(len(faces), dtype=np.int64)
    unsettled = np.arange(len(faces))
    for candidate in range(int(size.max(initial=0))):
        good = candidate < size[unsettled]
        count = size[unsettled]

        def corner(turn: int, start: Labels = begin[unsettled], count: Labels = count) -> Floats:
            return np.asarray(mesh.points_m[mesh.corners[start + turn % count]])

        origin = corner(candidate)
        outwards = origin - owned[unsettled]
        onwards = beyond[unsettled] - origin
        for turn in range(1, int(count.max(initial=0)) - 1):
            p1, p2 = corner(candidate + turn), corner(candidate + turn + 1)
            normal = np.cross(p1 - origin, p2 - origin)
            right = np.einsum("ij,ij->i", normal, outwards) > 0.0
            right &= (neighbour[unsettled] < 0) | (np.einsum("ij,ij->i", normal, onwards) > 0.0)
            good &= right | (turn > count - 2)
        base[unsettled[good]] = candidate
        unsettled = unsettled[~good]
        if not len(unsettled):
            break
    return base  # 0 where no corner will do, as OpenFOAM has it
