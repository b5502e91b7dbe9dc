"""Export of a spray to XML files for ParaView, without VTK: parcels as .vtp, gas as .vtu."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cldit.constants import AVOGADRO_PER_MOL
from cldit.io.vtk_files import VOXEL, Grid, Points, write_xml
from cldit.spray.result import Parcels, Spray


def parcel_points(parcels: Parcels) -> Points:
    """Points of the parcels in m; those that share a box fill it uniformly.

    Fields: diameter_m, temperature_K, droplets (their number), density_kg_m3, mass_kg.
    """
    names = ("diameter_m", "temperature_K", "droplets", "density_kg_m3")
    fields = {name: getattr(parcels, name) for name in names}
    return Points(parcels.points_m(), {**fields, "mass_kg": parcels.masses_kg})


def write_vtk(spray: Spray, folder: Path) -> list[Path]:
    """Writes `parcels.vtp` and `gas.vtu`, as far as the spray has them, and returns their paths.

    Parcels are those of `parcel_points`; the gas has cell data vapour_kg_m3, temperature_K.
    """
    written = []
    if spray.parcels is not None:
        written.append(folder / "parcels.vtp")
        write_xml(written[-1], parcel_points(spray.parcels))
    if (vapour := spray.vapour) is not None:
        cells = vapour.cells
        count = len(cells.lower_m)
        edge = cells.upper_m - cells.lower_m
        # Eight corners of each box.
        corners = (
            cells.lower_m[:, None]
            + edge[:, None] * np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
        ).reshape(-1, 3)
        fields = {
            "vapour_kg_m3": vapour.number_density_m3 * vapour.molar_mass_kg_mol / AVOGADRO_PER_MOL,
            "temperature_K": vapour.temperature_K,
        }
        nodes = np.arange(8 * count).reshape(-1, 8)
        written.append(folder / "gas.vtu")
        write_xml(written[-1], Grid(corners.astype(np.float32), nodes, VOXEL, fields))
    return written
