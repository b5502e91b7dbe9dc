"""Phase functions as tables for the kernels (kernels/phase.h).

A table has the share of light scattered into each bin of the cosine of the scattering angle. The
phase function is constant in a bin; its integral over the cosine is 1.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import ClditError

BINS = 1024
PHASE_STEPS = 1024  # of tables in equal steps of the sine of half the angle


class PhaseError(ClditError, ValueError):
    """Error of an impossible phase function."""


@dataclass(frozen=True)
class ScatteringTable:
    """Phase function in M bins.

    cosine: (M + 1,) bounds of the bins, from 1 down to -1.
    cumulative: (M + 1,) share scattered into larger cosines, from 0 to 1.
    classes: phase functions by class of droplet size, of which this is the mean; None: all cells
        have this one.
    """

    cosine: Floats
    cumulative: Floats
    classes: "SizeClasses | None" = None

    @classmethod
    def of(cls, cumulative: Callable[[Floats], Floats]) -> "ScatteringTable":
        """Table of a phase function, from its share above given cosines up to a factor."""
        cosine = cosine_bounds()
        share = cumulative(cosine)
        return cls(cosine, share / share[-1])

    @property
    def bins(self) -> int:
        """Number M of bins."""
        return len(self.cosine) - 1

    @property
    def tables(self) -> "tuple[ScatteringTable, ...]":
        """Phase function of each of K classes of droplet size; of one class, itself."""
        return (self,) if self.classes is None else self.classes.tables

    @property
    def density(self) -> Floats:
        """Phase function (M,) in each bin; 1/2 where it is isotropic."""
        return np.asarray(np.diff(self.cumulative) / -np.diff(self.cosine))

    @property
    def asymmetry(self) -> float:
        """Mean cosine of the scattering angle, g."""
        return float(self.moments(2)[1])

    def to_sample(self) -> Floats:
        """Table (3 M + 2,) for kernels/phase.h: cosines, cumulative shares, bins of k / M."""
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
        upper = scipy.special.eval_legendre(degrees + 1, self.cosine)
        lower = np.where(
            degrees > 0, scipy.special.eval_legendre(np.maximum(degrees - 1, 0), self.cosine), 1.0
        )
        integral = -np.diff((upper - lower) / (2 * degrees + 1), axis=1)
        return np.asarray(integral @ self.density)


@dataclass(frozen=True)
class SizeClasses:
    """Mean phase functions of droplets in K classes of size.

    bounds_m: (K - 1,) rising diameters between the classes.
    tables: phase function of each class, with the same bins.
    unresolved: RMS distance of the phase functions in the spray from those of the classes, see
        `size_classes`.
    """

    bounds_m: Floats
    tables: tuple[ScatteringTable, ...]
    unresolved: float

    def __post_init__(self) -> None:
        if len(self.tables) != len(self.bounds_m) + 1 or len(self.tables) < 2:
            raise PhaseError(
                f"size classes: {len(self.tables)} phase functions for {len(self.bounds_m)} bounds;"
                " allowed: one bound or more, and one phase function more than bounds"
            )

    def number(self, diameter_m: Floats) -> NDArray[np.intp]:
        """Class (N,) of droplets of `diameter_m` (N,)."""
        return np.asarray(np.searchsorted(self.bounds_m, diameter_m, "right"))


def cosine_bounds() -> Floats:
    """Bins evenly spaced in the angle: fine in cosine at the forward peak."""
    cosine = np.cos(np.linspace(0.0, np.pi, BINS + 1))
    cosine[0], cosine[-1] = 1.0, -1.0
    return np.asarray(cosine)
