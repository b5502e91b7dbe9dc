"""Phase functions of a spray's droplets by Mie theory, in bins of droplet size."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.optics import mie
from cldit.transport.phase import BINS, PhaseError, ScatteringTable, cosine_bounds

_SIZES = 64  # bins of the droplets' size parameter, evenly spaced in its logarithm
_NEGLIGIBLE = 1e-6  # share of a bin that is not solved; the sum over bins is below 1e-4
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(2)


@dataclass(frozen=True)
class SizeBins:
    """Scattering by droplets in S bins of size.

    edges_m: (S + 1,) diameters.
    share: (S,) of all scattering.
    within: (M, S) light that the droplets of a bin scatter into each bin of the cosine, in any
        unit; 0 for bins of negligible scattering.
    """

    edges_m: Floats
    share: Floats
    within: Floats

    @classmethod
    def of(
        cls, diameter_m: Floats, scattering_m2: Floats, *, wavelength_um: float, n: float, k: float
    ) -> "SizeBins":
        """Mie phase functions at the mean size parameter of each bin.

        Args:
            diameter_m: (N,) diameters.
            scattering_m2: (N,) scattering cross section of all droplets of each diameter.
            wavelength_um: in vacuum.
            n, k: refractive index n - ik.
        """
        scatters = (scattering_m2 > 0) & (diameter_m > 0)
        if not scatters.any():
            raise PhaseError("no droplet scatters light, so there is no mean phase function")
        log_x = np.log(np.pi * diameter_m[scatters] / (wavelength_um * 1e-6))
        weight = scattering_m2[scatters] / scattering_m2[scatters].sum()
        low, high = float(log_x.min()), float(log_x.max())
        step = max((high - low) / _SIZES, 1e-9)
        number = np.minimum(((log_x - low) / step).astype(int), _SIZES - 1)
        share = np.asarray(np.bincount(number, weight, minlength=_SIZES), np.float64)
        middle = np.bincount(number, weight * log_x, minlength=_SIZES) / np.where(
            share > 0, share, 1
        )
        angle = np.linspace(0.0, np.pi, BINS + 1)
        half = np.diff(angle)[:, None] / 2
        nodes = (angle[:-1, None] + half) + half * _NODES
        solved_bins = share > _NEGLIGIBLE
        series = mie.coefficients(n=n, k=k, x=mie.check(n=n, k=k, x=np.exp(middle[solved_bins])))
        intensity = mie.intensity(*series, np.cos(nodes.reshape(-1)))
        intensity = intensity.reshape(*nodes.shape, -1) * np.sin(nodes)[..., None]
        within = np.zeros((BINS, _SIZES))
        within[:, solved_bins] = np.einsum("bqs,bq,q->bs", intensity, half * np.ones(2), _WEIGHTS)
        edges = np.exp(low + step * np.arange(_SIZES + 1)) * (wavelength_um * 1e-6 / np.pi)
        return cls(edges, share, within)

    @property
    def solved(self) -> Mask:
        """Mask (S,) of the bins that have a phase function."""
        return np.asarray(self.share > _NEGLIGIBLE)

    def number(self, diameter_m: Floats) -> NDArray[np.intp]:
        """Bin (N,) of each diameter (N,)."""
        return np.clip(
            np.searchsorted(self.edges_m, diameter_m, "right") - 1, 0, len(self.share) - 1
        )

    def mean(self, first: int = 0, end: int | None = None) -> ScatteringTable:
        """Mean phase function of the bins first..end - 1, weighted by their scattering."""
        within, share = (part[..., first:end] for part in (self.within, self.share))
        solved_bins = self.solved[first:end]
        within, share = np.ascontiguousarray(within[:, solved_bins]), share[solved_bins]
        in_bin = within @ (share / within.sum(axis=0))
        cumulative = np.concatenate([[0.0], np.cumsum(in_bin)])
        return ScatteringTable(cosine_bounds(), cumulative / cumulative[-1])
