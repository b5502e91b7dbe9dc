"""What every parcel and gas cell absorbs, scatters and emits, as the octree takes it in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cldit.medium.octree import CellSource, PointSource
from cldit.optics.droplets import droplet_table
from cldit.optics.planck import band_radiance
from cldit.scene.schema import Optics
from cldit.spray.result import Parcels, Prescribed, Spray, Vapour

AVOGADRO_PER_MOL = 6.02214076e23


def emitters(
    spray: Spray, optics: Optics, *, cache: Path | None
) -> tuple[PointSource | None, list[CellSource]]:
    """Cross sections and emission of all of a spray (preset `paper`: one wavelength, paper Sec. 2).

    By Kirchhoff's law each phase emits its absorption times the photon radiance of a black body at
    its own temperature, integrated over the filter.

    Args:
        cache: folder for the Mie table; None builds it afresh.
    """
    cells = []
    if spray.vapour is not None and len(spray.vapour.number_density_m3):
        cells.append(_vapour(spray.vapour, optics))
    if spray.prescribed is not None and len(spray.prescribed.vapour_absorption_per_m):
        cells.append(_prescribed(spray.prescribed, optics))
    points = None
    if spray.parcels is not None and len(spray.parcels.diameter_m):
        points = _droplets(spray.parcels, optics, cache)
    return points, cells


def _droplets(parcels: Parcels, optics: Optics, cache: Path | None) -> PointSource:
    table = droplet_table(wavelength_um=optics.wavelength_um, n=optics.n, k=optics.k, cache=cache)
    absorption, scattering = table.cross_sections(parcels.diameter_m)
    absorption = absorption * parcels.droplets
    radiance = band_radiance(parcels.temperature_K, filter_um=optics.filter_um)
    return PointSource(
        position_m=parcels.position_m,
        absorption_m2=absorption,
        scattering_m2=scattering * parcels.droplets,
        emission_m2=absorption * radiance,
    )


def _vapour(vapour: Vapour, optics: Optics) -> CellSource:
    cross_section_m2 = optics.vapour_m2_mol / AVOGADRO_PER_MOL
    absorption = vapour.number_density_m3 * cross_section_m2
    none = np.zeros_like(absorption)
    return CellSource(
        lower_m=vapour.cells.lower_m,
        upper_m=vapour.cells.upper_m,
        vapour_absorption=absorption,
        vapour_emission=absorption
        * band_radiance(vapour.temperature_K, filter_um=optics.filter_um),
        droplet_absorption=none,
        droplet_scattering=none,
        droplet_emission=none,
    )


def _prescribed(given: Prescribed, optics: Optics) -> CellSource:
    vapour = band_radiance(given.vapour_temperature_K, filter_um=optics.filter_um)
    liquid = band_radiance(given.droplet_temperature_K, filter_um=optics.filter_um)
    return CellSource(
        lower_m=given.cells.lower_m,
        upper_m=given.cells.upper_m,
        vapour_absorption=given.vapour_absorption_per_m,
        vapour_emission=given.vapour_absorption_per_m * vapour,
        droplet_absorption=given.droplet_absorption_per_m,
        droplet_scattering=given.droplet_scattering_per_m,
        droplet_emission=given.droplet_absorption_per_m * liquid,
    )
