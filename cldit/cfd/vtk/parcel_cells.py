"""Parcels of VTK data sets, whatever the cells that join their points."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import NO_CLOUD
from cldit.cfd.mesh.cells import Labels
from cldit.cfd.vtk.datasets import as_numpy, cell_lists, dimension
from cldit.cfd.vtk.ghosts import as_points
from cldit.cfd.vtk.reading import Loaded
from cldit.errors import SprayError


def parcels_of(piece: Loaded, drops: Sequence[str]) -> Loaded:
    """Points with the fields of parcels, which may belong to vertices as cells.

    drops: fields that mark parcels, of their size and number; none for a cloud that is named.
    Lines that join parcels of one time are ignored; those that follow single parcels, and
    surfaces, such as glyphs, are refused.
    """
    data = piece.data
    in_cells = set(drops) <= piece.cell_names and not set(drops) <= piece.point_names
    if not drops or (dimension(data) <= 0 and not in_cells):
        return piece
    nodes, start = cell_lists(data)
    if dimension(data) == 2 or (in_cells and np.any(np.diff(start) != 1)):
        raise _refusal(piece, drops, "on lines or surfaces, such as glyphs")
    if not in_cells:
        if _follow_parcels(piece, drops[-1], nodes, start):
            raise _refusal(piece, drops, "on lines along which a parcel keeps its number: tracks")
        return replace(piece, data=as_points(data, np.arange(data.GetNumberOfPoints())))
    points = as_points(data, nodes)
    points.GetPointData().ShallowCopy(data.GetCellData())
    return replace(piece, data=points, point_names=piece.cell_names)


def _follow_parcels(piece: Loaded, number: str, nodes: Labels, start: Labels) -> bool:
    """True if numbers or masses stay or fall, and ages only rise or only fall, along all lines."""
    inside = np.ones(len(nodes), dtype=bool)
    inside[start[:-1][np.diff(start) > 0]] = False  # the first point of a line
    later = np.flatnonzero(inside)

    def steps(name: str) -> Floats:
        values = as_numpy(piece.data.GetPointData().GetArray(name)).astype(np.float64)
        return np.asarray(values[nodes[later]] - values[nodes[later - 1]])

    if not len(later) or np.any(steps(number) > 0):
        return False
    ages = steps("age") if "age" in piece.point_names else np.zeros(1)
    return bool(np.all(ages >= 0) or np.all(ages <= 0))


def _refusal(piece: Loaded, drops: Sequence[str], where: str) -> SprayError:
    return SprayError(
        f"{piece.file}: has {' and '.join(drops)}, the fields of parcels, {where}; save the "
        "points of one time as vertices, or name the cloud to be read (spray.cloud; "
        f"{NO_CLOUD} for gas alone)"
    )
