"""What a spray's substances do to the light of one band: of the paper, or of one spectral node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.optics.droplets import DropletTable, droplet_table
from cldit.optics.planck import band_radiance
from cldit.optics.response import Filter
from cldit.scene.optics import Optics

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Droplets:
    """Mie tables of one liquid at rising temperatures (M,), linear in between and held beyond."""

    temperature_K: Floats
    tables: tuple[DropletTable, ...]

    def cross_sections(self, diameter_m: Floats, temperature_K: Floats) -> tuple[Floats, Floats]:
        """C_abs and C_sca [m2], (N,), of droplets of `diameter_m` (N,) at `temperature_K` (N,).

        Raises:
            DropletError: a diameter is outside the tables.
        """
        if len(self.tables) == 1:
            return self.tables[0].cross_sections(diameter_m)
        absorption, scattering = np.zeros_like(diameter_m), np.zeros_like(diameter_m)
        place = np.interp(temperature_K, self.temperature_K, np.arange(len(self.tables)))
        for number, table in enumerate(self.tables):
            share = np.maximum(1.0 - np.abs(place - number), 0.0)
            here = share > 0.0
            if np.any(here):
                parts = table.cross_sections(diameter_m[here])
                absorption[here] += share[here] * parts[0]
                scattering[here] += share[here] * parts[1]
        return absorption, scattering


@dataclass(frozen=True)
class BandOptics:
    """One band: black-body photon radiance, vapour's molar absorption, and droplets.

    radiance: photons s-1 m-2 sr-1 over temperature. vapour_m2_mol: over temperature, (N,).
    droplets: None where the spray has none.
    """

    radiance: Callable[[ArrayLike], Floats]
    vapour_m2_mol: Callable[[Floats], Floats]
    droplets: Droplets | None

    @classmethod
    def paper(
        cls, optics: Optics, filter_um: Filter, *, droplets: bool, cache: Path | None
    ) -> BandOptics:
        """One wavelength, one refractive index, one vapour cross section (paper, Section 2).

        Args:
            optics: the scene's.
            filter_um: edges of the filter.
            droplets: whether there are any.
            cache: folder for the Mie table; None builds it afresh.
        """
        table = None
        if droplets:
            table = Droplets(
                np.array([0.0]),
                (
                    droplet_table(
                        wavelength_um=optics.wavelength_um, n=optics.n, k=optics.k, cache=cache
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
