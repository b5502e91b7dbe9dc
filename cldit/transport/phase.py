"""Phase functions as tables that kernels sample (kernels/phase.h).

A table has the share of light scattered into each bin of the cosine of the scattering angle. The
phase function is constant in a bin; its integral over the cosine is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_legendre

from cldit.errors import ClditError
from cldit.optics import mie
from cldit.optics.band import Droplets
from cldit.spray.result import Parcels

Floats = NDArray[np.float64]

_BINS = 1024
PHASE_STEPS = 1024  # of tables in equal steps of the sine of half the angle
_SIZES = 64  # classes of the droplets' size parameter, evenly spaced in its logarithm
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(2)


class PhaseError(ClditError, ValueError):
    """An impossible phase function."""


@dataclass(frozen=True)
class ScatteringTable:
    """Phase function in M bins.

    cosine: (M + 1,) bounds of the bins, from 1 down to -1.
    cumulative: (M + 1,) share that is scattered into larger cosines, from 0 to 1.
    """

    cosine: Floats
    cumulative: Floats

    @property
    def bins(self) -> int:
        """Number M of bins."""
        return len(self.cosine) - 1

    @property
    def density(self) -> Floats:
        """Phase function (M,) in each bin; 1/2 where it is isotropic."""
        return np.asarray(np.diff(self.cumulative) / -np.diff(self.cosine))

    @property
    def asymmetry(self) -> float:
        """Mean cosine of the scattering angle, g."""
        return float(self.moments(2)[1])

    @property
    def forward(self) -> float:
        """Forward fraction f of the delta-M method for two moments: the third moment.

        So the third moment is right too (Wiscombe, J. Atmos. Sci. 34, 1977).
        """
        return max(float(self.moments(4)[3]), 0.0)

    def to_sample(self) -> Floats:
        """Table (3 M + 2,) of kernels/phase.h: cosines, cumulative shares, bins of k / M."""
        even = np.arange(self.bins) / self.bins
        bins = np.searchsorted(self.cumulative, even, "right") - 1
        return np.concatenate([self.cosine, self.cumulative, np.minimum(bins, self.bins - 1)])

    def by_half_sine(self, steps: int) -> Floats:
        """Phase function (steps,) in equal steps of the sine of half the scattering angle."""
        cosine = 1 - 2 * np.linspace(0.0, 1.0, steps + 1) ** 2
        share = np.interp(-cosine, -self.cosine, self.cumulative)
        return np.asarray(np.diff(share) / -np.diff(cosine))

    def moments(self, count: int) -> Floats:
        """Exact Legendre moments (count,) of the table; moment 0 is 1 and moment 1 is g."""
        degrees = np.arange(count)[:, None]
        upper = eval_legendre(degrees + 1, self.cosine)
        lower = np.where(degrees > 0, eval_legendre(np.maximum(degrees - 1, 0), self.cosine), 1.0)
        integral = -np.diff((upper - lower) / (2 * degrees + 1), axis=1)
        return np.asarray(integral @ self.density)


def _bounds() -> Floats:
    """Bins evenly spaced in the angle: fine in cosine at the forward peak."""
    cosine = np.cos(np.linspace(0.0, np.pi, _BINS + 1))
    cosine[0], cosine[-1] = 1.0, -1.0
    return np.asarray(cosine)


def henyey_greenstein(g: float) -> ScatteringTable:
    """The phase function of Henyey and Greenstein (Astrophys. J. 93, 1941).

    Args:
        g: mean cosine of the scattering angle, -1 < g < 1.

    Raises:
        PhaseError: g is out of range.
    """
    if not -1 < g < 1:
        raise PhaseError(f"Henyey-Greenstein: g = {g:g} is outside -1..1 (both excluded)")
    cosine = _bounds()
    if abs(g) < 1e-6:
        return ScatteringTable(cosine, (1 - cosine) / 2)
    root = np.sqrt(1 + g * g - 2 * g * cosine)
    cumulative = (1 - g * g) / (2 * g) * (1 / abs(1 - g) - 1 / root)
    cumulative /= cumulative[-1]
    return ScatteringTable(cosine, cumulative)


def mean_of(
    parcels: Parcels | None, droplets: Droplets | None, scattering_m2: Floats | None
) -> ScatteringTable | None:
    """Mean phase function of a spray's droplets, weighted by their scattering cross sections.

    Args:
        parcels: N parcels of equal droplets.
        droplets: Mie tables; the refractive index is that of the middle temperature.
        scattering_m2: (N,) scattering cross section of all of a parcel's droplets.

    Returns:
        The table; None where no droplet scatters.
    """
    if parcels is None or droplets is None or scattering_m2 is None or not scattering_m2.any():
        return None
    table = droplets.tables[len(droplets.tables) // 2]
    return mie_table(
        parcels.diameter_m,
        scattering_m2,
        wavelength_um=table.wavelength_um,
        n=table.n,
        k=table.k,
    )


def mie_table(
    diameter_m: Floats, scattering_m2: Floats, *, wavelength_um: float, n: float, k: float
) -> ScatteringTable:
    """Mean Mie phase function of droplets, weighted by scattering cross sections.

    Args:
        diameter_m: (N,) diameters.
        scattering_m2: (N,) scattering cross section of all droplets of each diameter.
        wavelength_um: in vacuum.
        n, k: refractive index n - ik.

    Raises:
        PhaseError: nothing scatters.
    """
    scatters = (scattering_m2 > 0) & (diameter_m > 0)
    if not scatters.any():
        raise PhaseError("no droplet scatters light, so there is no mean phase function")
    log_x = np.log(np.pi * diameter_m[scatters] / (wavelength_um * 1e-6))
    weight = scattering_m2[scatters] / scattering_m2[scatters].sum()
    low, high = float(log_x.min()), float(log_x.max())
    step = max((high - low) / _SIZES, 1e-9)
    number = np.minimum(((log_x - low) / step).astype(int), _SIZES - 1)
    share = np.bincount(number, weight, minlength=_SIZES)
    middle = np.bincount(number, weight * log_x, minlength=_SIZES) / np.where(share > 0, share, 1)
    cosine = _bounds()
    angle = np.linspace(0.0, np.pi, _BINS + 1)
    half = np.diff(angle)[:, None] / 2
    nodes = (angle[:-1, None] + half) + half * _NODES
    some = share > 1e-6  # what is left out is less than 1e-4 of all
    series = mie.coefficients(n=n, k=k, x=mie.check(n=n, k=k, x=np.exp(middle[some])))
    intensity = mie.intensity(*series, np.cos(nodes.reshape(-1)))
    intensity = intensity.reshape(*nodes.shape, -1) * np.sin(nodes)[..., None]
    in_bin = np.einsum("bqs,bq,q->bs", intensity, half * np.ones(2), _WEIGHTS)
    within = in_bin @ (share[some] / in_bin.sum(axis=0))
    cumulative = np.concatenate([[0.0], np.cumsum(within)])
    return ScatteringTable(cosine, cumulative / cumulative[-1])
