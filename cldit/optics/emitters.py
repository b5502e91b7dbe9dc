"""What every parcel and gas cell absorbs, scatters and emits, as the octree takes it in."""

from __future__ import annotations

import numpy as np

from cldit.medium.octree import CellSource, PointSource
from cldit.optics.band import BandOptics, Droplets
from cldit.spray.result import Parcels, Prescribed, Spray, Vapour

AVOGADRO_PER_MOL = 6.02214076e23


def emitters(spray: Spray, band: BandOptics) -> tuple[PointSource | None, list[CellSource]]:
    """Cross sections and emission of all of a spray in one band.

    By Kirchhoff's law each phase emits its absorption times the photon radiance of a black body at
    its own temperature in the band.
    """
    cells = []
    if spray.vapour is not None and len(spray.vapour.number_density_m3):
        cells.append(_vapour(spray.vapour, band))
    if spray.prescribed is not None and len(spray.prescribed.vapour_absorption_per_m):
        cells.append(_prescribed(spray.prescribed, band))
    points = None
    if spray.parcels is not None and band.droplets is not None and len(spray.parcels.diameter_m):
        points = _droplets(spray.parcels, band, band.droplets)
    return points, cells


def _droplets(parcels: Parcels, band: BandOptics, droplets: Droplets) -> PointSource:
    absorption, scattering = droplets.cross_sections(parcels.diameter_m, parcels.temperature_K)
    absorption = absorption * parcels.droplets
    return PointSource(
        position_m=parcels.position_m,
        absorption_m2=absorption,
        scattering_m2=scattering * parcels.droplets,
        emission_m2=absorption * band.radiance(parcels.temperature_K),
        extent=parcels.extent,
    )


def _vapour(vapour: Vapour, band: BandOptics) -> CellSource:
    cross_section_m2 = band.vapour_m2_mol(vapour.temperature_K) / AVOGADRO_PER_MOL
    absorption = vapour.number_density_m3 * cross_section_m2
    none = np.broadcast_to(0.0, absorption.shape)  # stored once, not for each cell
    return CellSource(
        lower_m=vapour.cells.lower_m,
        upper_m=vapour.cells.upper_m,
        vapour_absorption=absorption,
        vapour_emission=absorption * band.radiance(vapour.temperature_K),
        droplet_absorption=none,
        droplet_scattering=none,
        droplet_emission=none,
    )


def _prescribed(given: Prescribed, band: BandOptics) -> CellSource:
    vapour = band.radiance(given.vapour_temperature_K)
    liquid = band.radiance(given.droplet_temperature_K)
    return CellSource(
        lower_m=given.cells.lower_m,
        upper_m=given.cells.upper_m,
        vapour_absorption=given.vapour_absorption_per_m,
        vapour_emission=given.vapour_absorption_per_m * vapour,
        droplet_absorption=given.droplet_absorption_per_m,
        droplet_scattering=given.droplet_scattering_per_m,
        droplet_emission=given.droplet_absorption_per_m * liquid,
    )
