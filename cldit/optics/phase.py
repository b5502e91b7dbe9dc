"""Mie phase functions of droplets over size, per steradian.

The phase function of a sphere is a polynomial in cos(angle) of degree 2 N, with N terms of the Mie
series; it is stored at the Gauss-Legendre nodes that integrate it exactly for the largest droplet
of the table. Entries are means, weighted by scattering cross section, over a triangle of one step
to both sides: they suit interpolation and size distributions, not single droplets.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import DropletError
from cldit.io.content import code_digest
from cldit.io.tables import Arrays, cached
from cldit.optics import mie
from cldit.optics.droplets import SMALLEST_M

_SIZES = 192  # steps of 0.048 in ln d, from 0.05 um to 500 um
_WITHIN = 8  # samples from one size of the table to the next


@dataclass(frozen=True)
class PhaseFunction:
    """A phase function at Gauss-Legendre nodes.

    cosine: (M,) rising. weights: (M,). density_per_sr: (M,).
    """

    cosine: Floats
    weights: Floats
    density_per_sr: Floats

    @property
    def asymmetry(self) -> float:
        """g, the mean cosine."""
        return float(2 * np.pi * np.sum(self.weights * self.density_per_sr * self.cosine))

    def moments(self, count: int) -> Floats:
        """Legendre moments 0 .. count - 1: means of P_l; the first is 1, the second g."""
        values = np.polynomial.legendre.legvander(self.cosine, count - 1)
        return np.asarray(2 * np.pi * (self.weights * self.density_per_sr) @ values)


@dataclass(frozen=True)
class PhaseTable:
    """Phase functions over size for one wavelength and liquid; made by `phase_table`.

    diameter_m: (S,), even in ln d. cosine, weights: (M,). density_per_sr: (S, M).
    scattering_m2: (S,), the cross section by which entries are averaged.
    """

    wavelength_um: float
    n: float
    k: float
    diameter_m: Floats
    cosine: Floats
    weights: Floats
    density_per_sr: Floats
    scattering_m2: Floats

    def mean(self, diameter_m: ArrayLike, number: ArrayLike) -> PhaseFunction:
        """Mean over `number` (N,) droplets of each `diameter_m` (N,), weighted by scattering.

        Below 0.05 um the smallest entry, the Rayleigh limit, is used.
        """
        d, count = np.broadcast_arrays(
            np.atleast_1d(np.asarray(diameter_m, float)), np.asarray(number, float)
        )
        largest = self.diameter_m[-1]
        if not (d.size and d.min() > 0 and d.max() <= largest * (1 + 1e-9)):
            raise DropletError(
                f"phase function: droplet diameters must be above 0 and at most {largest:g} m, "
                "the range of the table"
            )
        log = np.log(self.diameter_m)
        place = np.clip((np.log(d) - log[0]) / (log[1] - log[0]), 0, len(log) - 1)
        cell = np.minimum(place.astype(np.intp), len(log) - 2)
        part = place - cell
        small = np.minimum(d / self.diameter_m[0], 1.0) ** 6  # Rayleigh below the table
        lower = np.bincount(cell, count * small * (1 - part), len(log))
        upper = np.bincount(cell + 1, count * small * part, len(log))
        share = (lower + upper) * self.scattering_m2
        if not (np.all(share >= 0) and 0 < share.sum() < np.inf):
            raise DropletError("phase function: the numbers of droplets give nothing to average")
        density = (share / share.sum()) @ self.density_per_sr
        return PhaseFunction(self.cosine, self.weights, density)


def phase_table(
    *, wavelength_um: float, n: float, k: float, cache: Path | None, largest_m: float = 100e-6
) -> PhaseTable:
    """Phase functions from 0.05 um to `largest_m`, kept by content in the folder `cache`."""
    if not (wavelength_um > 0 and SMALLEST_M * 2 <= largest_m < np.inf):
        raise DropletError(
            f"phase functions: wavelength {wavelength_um:g} um, largest diameter {largest_m:g} m; "
            f"allowed: wavelengths above 0 and diameters from {2 * SMALLEST_M:g} m"
        )
    arrays = cached(
        cache,
        kind="phase",
        description=f"{code_digest('optics')} {wavelength_um!r} {n!r} {k!r} {largest_m!r}",
        make=lambda: _solve(wavelength_um=wavelength_um, n=n, k=k, largest_m=largest_m),
    )
    names = ("diameter_m", "cosine", "weights", "density_per_sr", "scattering_m2")
    return PhaseTable(wavelength_um, n, k, *(arrays[name] for name in names))


def _check_scatters(*, n: float, k: float) -> None:
    if n == 1 and k == 0:
        raise DropletError("phase function: n = 1 and k = 0 scatter nothing")


def _solve(*, wavelength_um: float, n: float, k: float, largest_m: float) -> Arrays:
    knots = np.geomspace(SMALLEST_M, largest_m, _SIZES)
    step = np.log(knots[1] / knots[0])
    # Rising samples; the hats of the two outermost entries reach one step beyond them.
    offsets = np.arange(-_WITHIN + 1, (_SIZES - 1) * _WITHIN + _WITHIN)
    diameter = SMALLEST_M * np.exp(step / _WITHIN * offsets)
    x = np.pi * diameter * 1e6 / wavelength_um
    mie.check(n=n, k=k, x=x)
    _check_scatters(n=n, k=k)
    # At least one cosine a degree in the mean.
    cosine, weights = leggauss(max(mie.terms(float(x[-1])) + 1, 181))
    front = (wavelength_um * 1e-6 / (2 * np.pi)) ** 2  # intensity / wavenumber^2 is dC / d omega
    hat = 1 - np.abs(np.arange(-_WITHIN + 1, _WITHIN)) / _WITHIN
    hat /= hat.sum()
    density = np.zeros((_SIZES, cosine.size))
    for knot in range(_SIZES):
        part = x[knot * _WITHIN : knot * _WITHIN + hat.size]
        intensity = mie.intensity(*mie.coefficients(n=n, k=k, x=part), cosine)
        density[knot] = front * (intensity @ hat)
    scattering = 2 * np.pi * density @ weights
    return {
        "diameter_m": knots,
        "cosine": cosine,
        "weights": weights,
        "density_per_sr": density / scattering[:, None],
        "scattering_m2": scattering,
    }
