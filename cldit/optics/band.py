"""Optical properties of a spray in one band: the paper's, or those of one spectral node.

`BandOptics` has the properties of the substances; `emitters` applies them to parcels and gas cells.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.constants import AVOGADRO_PER_MOL
from cldit.medium.octree import CellSource, PointSource
from cldit.optics.droplets import DropletTable, droplet_table
from cldit.optics.planck import band_radiance
from cldit.optics.response import Filter
from cldit.scene.optics import Optics
from cldit.spray.result import Parcels, Prescribed, Spray, Vapour


@dataclass(frozen=True)
class Droplets:
    """Mie tables of one liquid at rising temperatures (M,): linear in between, constant beyond."""

    temperature_K: Floats
    tables: tuple[DropletTable, ...]

    def cross_sections(self, diameter_m: Floats, temperature_K: Floats) -> tuple[Floats, Floats]:
        """C_abs and C_sca [m2], (N,), of droplets of `diameter_m` (N,) at `temperature_K` (N,)."""
        if len(self.tables) == 1:
            return self.tables[0].cross_sections(diameter_m)
        absorption, scattering = np.zeros_like(diameter_m), np.zeros_like(diameter_m)
        place = np.interp(temperature_K, self.temperature_K, np.arange(len(self.tables)))
        for number, table in enumerate(self.tables):
            share = np.maximum(1.0 - np.abs(place - number), 0.0)
            near = share > 0.0
            if np.any(near):
                parts = table.cross_sections(diameter_m[near])
                absorption[near] += share[near] * parts[0]
                scattering[near] += share[near] * parts[1]
        return absorption, scattering


@dataclass(frozen=True)
class BandOptics:
    """Properties of the substances in one band.

    radiance: of a black body, photons s-1 m-2 sr-1, as a function of temperature.
    vapour_m2_mol: molar absorption cross section as a function of temperature (N,).
    droplets: None for a spray without droplets.
    """

    radiance: Callable[[ArrayLike], Floats]
    vapour_m2_mol: Callable[[Floats], Floats]
    droplets: Droplets | None

    @classmethod
    def paper(
        cls, optics: Optics, filter_um: Filter, *, largest_m: float, cache: Path | None
    ) -> "BandOptics":
        """The paper's properties: one wavelength, refractive index and vapour cross section.

        largest_m: diameter of the largest droplet; 0: there is none. The Mie table is kept in the
        folder `cache`, and built anew if that is None.
        """
        table = None
        if largest_m:
            table = Droplets(
                np.array([0.0]),
                (
                    droplet_table(
                        wavelength_um=optics.wavelength_um,
                        n=optics.n,
                        k=optics.k,
                        cache=cache,
                        largest_m=largest_m,
                    ),
                ),
            )
        return cls(
            radiance=partial(band_radiance, filter_um=filter_um),
            vapour_m2_mol=lambda temperature_K: np.full(
                np.shape(temperature_K), optics.vapour_m2_mol
            ),
            droplets=table,
        )


def emitters(spray: Spray, band: BandOptics) -> tuple[PointSource | None, list[CellSource]]:
    """Cross sections and emission of a spray's droplets (None without any) and gas in one band.

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


def _prescribed(prescribed: Prescribed, band: BandOptics) -> CellSource:
    vapour = band.radiance(prescribed.vapour_temperature_K)
    liquid = band.radiance(prescribed.droplet_temperature_K)
    return CellSource(
        lower_m=prescribed.cells.lower_m,
        upper_m=prescribed.cells.upper_m,
        vapour_absorption=prescribed.vapour_absorption_per_m,
        vapour_emission=prescribed.vapour_absorption_per_m * vapour,
        droplet_absorption=prescribed.droplet_absorption_per_m,
        droplet_scattering=prescribed.droplet_scattering_per_m,
        droplet_emission=prescribed.droplet_absorption_per_m * liquid,
    )
