"""Kernel density estimate of a spray: each parcel of a sample becomes a cloud.

A parcel is spread with the covariance of its nearest neighbours, times a width squared: wide where
parcels are sparse, narrow where they are dense, narrower across a plume than along it. Spreading
alone would widen the spray by as much, most visibly where it is narrow. So each parcel first moves
towards the mean of its neighbours, by half of the widening: the bias is then of fourth order in the
width instead of second ("data sharpening": Choi and Hall, Biometrika 86, 941, 1999). For neighbours
of mean m and covariance S in a density f, m - x = S grad f / f to first order, and a kernel of
covariance C needs the step C grad f / (2 f): with C = w^2 S it is w^2 (m - x) / 2. Numbers, sizes
and temperatures of the droplets do not change; nothing is random.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from cldit.arrays import Floats
from cldit.errors import MediumError
from cldit.medium.frame import AT_ONCE
from cldit.spray.extent import Cloud
from cldit.spray.result import Parcels, Spray

NEIGHBOURS = 16
WIDTH = 1.4
_WIDEST = 0.5  # largest standard deviation of a kernel, over that of all parcels
# Error of all parcels over the difference of the halves: the error of T_app of gdi-flow goes with
# the power -1/3 of the number of parcels (6.3 to 2.9 K from 2,700 to 27,000), and a difference has
# two independent errors.
SAMPLING = 2.0 ** -(1 / 2 + 1 / 3)
_ROUND = 0.1  # isotropic share of the covariance, which 16 neighbours overestimate lengthwise


@dataclass(frozen=True)
class Kernel:
    """Spreading of parcels: number of neighbours, including the parcel itself, and width.

    width: standard deviation of a parcel over that of its neighbours. exposure_s: time over which
    parcels are smeared along their velocity.
    """

    neighbours: int = NEIGHBOURS
    width: float = WIDTH
    exposure_s: float = 0.0

    def __post_init__(self) -> None:
        if not 4 <= self.neighbours <= 1000:
            raise MediumError(f"kernel: {self.neighbours} neighbours; allowed: 4..1000")
        if not 0 < self.width <= 10:
            raise MediumError(f"kernel: width {self.width:g}; allowed: above 0 to 10")

    def spread(self, parcels: Parcels) -> Parcels:
        """Same parcels as clouds; parcels that fill boxes are unchanged.

        Parcels without droplets do not count. With fewer places than neighbours all are neighbours;
        parcels that are all in one place remain points. Raises MediumError if they are clouds.
        """
        if not parcels.sampled:
            return parcels
        if parcels.extent is not None:
            raise MediumError("kernel: the parcels are clouds already, and have been moved")
        place = parcels.position_m.copy()
        covariance = np.zeros((len(place), 3, 3))
        filled = parcels.droplets > 0
        # Neighbours are distinct places: parcels in one place would only have each other.
        distinct, copy = np.unique(place[filled], axis=0, return_inverse=True)
        if len(distinct) > 1:
            moved, spread = self._clouds(distinct)
            place[filled], covariance[filled] = moved[copy], spread[copy]
        clouds = replace(parcels, position_m=place, extent=Cloud(covariance))
        return smeared(clouds, self.exposure_s)

    def _clouds(self, places: Floats) -> tuple[Floats, Floats]:
        """New position (N, 3) of each place (N, 3), and its covariance (N, 3, 3)."""
        count = min(self.neighbours, len(places))
        limit = _WIDEST**2 * float(places.var(axis=0).sum())
        tree = scipy.spatial.cKDTree(places)
        moved, covariance = np.empty_like(places), np.empty((len(places), 3, 3))
        part_size = AT_ONCE // count
        for start in range(0, len(places), part_size):
            part = slice(start, start + part_size)
            neighbours = places[tree.query(places[part], count, workers=-1)[1]]
            mean = neighbours.mean(axis=1)
            offset = neighbours - mean[:, None]
            spread = np.matmul(offset.transpose(0, 2, 1), offset) / (count - 1)
            trace = np.trace(spread, axis1=1, axis2=2)
            even = trace[:, None, None] / 3 * np.eye(3)
            width2 = np.minimum(self.width**2, limit / trace)
            covariance[part] = width2[:, None, None] * ((1 - _ROUND) * spread + _ROUND * even)
            # An isolated place has no gradient: it moves by less than its neighbours are wide.
            step = mean - places[part]
            step *= np.minimum(1.0, np.sqrt(trace) / np.maximum(_length(step), 1e-30))[:, None]
            moved[part] = places[part] + width2[:, None] / 2 * step
        return moved, covariance


def smeared(parcels: Parcels, exposure_s: float) -> Parcels:
    """Parcels as clouds with the variance of their motion during an exposure, v v' t^2 / 12.

    The time t is centred at that of the parcels. Parcels without velocity, and boxes, stay.
    """
    velocity = parcels.velocity_m_s
    if velocity is None or not parcels.sampled or exposure_s == 0.0:
        return parcels
    motion = exposure_s**2 / 12.0 * velocity[:, :, None] * velocity[:, None, :]
    if isinstance(parcels.extent, Cloud):
        motion += parcels.extent.covariance_m2
    return replace(parcels, extent=Cloud(motion))


def _length(vector: Floats) -> Floats:
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", vector, vector)))


def halves(parcels: Parcels, *, seed: int, copies: int = 1) -> tuple[Parcels, Parcels]:
    """Two sprays of half of the parcels each, drawn at random, each with the mass of all.

    With `copies`, the parcels are so many equal parts, one after the other, of equal plumes: all
    copies of a parcel are in the same half, since they share its error.

    Spread each half again: clouds of all parcels have followed their noise already, and their
    halves would differ by too little (`variants`). Raises MediumError if the parcels are not a
    sample, or if fewer than two have droplets.
    """
    if not parcels.sampled:
        raise MediumError("halves: these parcels are not a sample; their sampling error is 0")
    filled = np.flatnonzero(parcels.droplets > 0)
    if len(filled) < 2:
        raise MediumError(f"halves: {len(filled)} parcels with droplets, at least 2 are needed")
    filled = filled[filled < len(parcels.droplets) // copies]
    chosen = np.zeros(len(parcels.droplets) // copies, bool)
    chosen[np.random.default_rng(seed).permutation(filled)[: len(filled) // 2]] = True
    chosen = np.tile(chosen, copies)
    total_kg = parcels.mass_kg

    def weighted(half: Parcels) -> Parcels:
        # By mass instead of 2: the mass of the spray is known, and has no sampling error.
        return replace(half, droplets=half.droplets * (total_kg / half.mass_kg))

    return weighted(parcels.take(chosen)), weighted(parcels.take(~chosen))


def copies_of(spray: Spray) -> int:
    """Number of equal parts that the parcels of a spray consist of."""
    copies = int(spray.notes.get("equal_plumes", 1))
    count = 0 if spray.parcels is None else len(spray.parcels.droplets)
    return copies if count % copies == 0 else 1


def variants(spray: Spray, *, kernel: Kernel, seed: int) -> tuple[Spray, Spray, Spray]:
    """Sprays whose images show the error of a sample of parcels, which are points.

    The first two are `halves`, drawn by `seed`, each spread separately by `kernel`; the third are
    clouds of all parcels, of half of the variance. SAMPLING times the RMS difference of the halves'
    images is the sampling error of the whole; 4/3 of (whole - narrower) is about the bias of the
    width, which falls with its fourth power, and the additional noise of narrower clouds: an upper
    bound. Raises MediumError if the parcels are no sample of points.
    """
    if spray.parcels is None:
        raise MediumError("variants: the spray has no parcels")
    narrow = replace(kernel, width=kernel.width / 2**0.5).spread(spray.parcels)
    one_half, rest = (
        kernel.spread(half) for half in halves(spray.parcels, seed=seed, copies=copies_of(spray))
    )
    return (
        replace(spray, parcels=one_half),
        replace(spray, parcels=rest),
        replace(spray, parcels=narrow),
    )
