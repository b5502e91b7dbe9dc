"""Parcels of a sample become a cloud: what each stands for lies about it, not in one point.

A parcel is spread with the covariance of its nearest neighbours, times a width squared: wide where
parcels are few, narrow where they are many, narrower across a plume than along it. Spreading
alone widens the spray by as much, which shows most where it is narrow. So each parcel first moves
towards the mean of its neighbours, by half of what the spreading would undo: its bias is then of
fourth order in the width instead of second ("data sharpening": Choi and Hall, Biometrika 86, 941,
1999). For neighbours of mean m and covariance S in a density f, m - x = S grad f / f to first
order, and a kernel of covariance C needs the step C grad f / (2 f): with C = w^2 S it is
w^2 (m - x) / 2. Droplets, sizes and temperatures stay as they are; nothing is drawn at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cldit.errors import MediumError
from cldit.spray.extent import Cloud
from cldit.spray.result import Parcels, Spray

Floats = NDArray[np.float64]

NEIGHBOURS = 16
WIDTH = 1.4
_WIDEST = 0.5  # of a kernel's standard deviation, over that of all parcels
# Of the halves' difference, what the whole errs by: T_app of gdi-flow errs by the power -1/3 of the
# number of parcels (6.3 to 2.9 K from 2,700 to 27,000), and two errors make a difference.
SAMPLING = 2.0 ** -(1 / 2 + 1 / 3)
_ROUND = 0.1  # of the covariance, taken from its mean: 16 neighbours make it longer than it is
_AT_ONCE = 100_000  # parcels whose neighbours are in memory together


@dataclass(frozen=True)
class Kernel:
    """How parcels are spread: over which neighbours, the parcel itself among them, and how wide.

    width: standard deviation of a parcel over that of its neighbours.
    """

    neighbours: int = NEIGHBOURS
    width: float = WIDTH

    def __post_init__(self) -> None:
        if not 4 <= self.neighbours <= 1000:
            raise MediumError(f"kernel: {self.neighbours} neighbours, allowed is 4..1000")
        if not 0 < self.width <= 10:
            raise MediumError(f"kernel: width {self.width:g}, allowed is above 0, at most 10")

    def spread(self, parcels: Parcels) -> Parcels:
        """The same parcels as clouds; those that are known to fill boxes stay as they are.

        Parcels without droplets take no part. With fewer places than neighbours all are
        neighbours; parcels that all lie in one place stay points.

        Raises:
            MediumError: the parcels are clouds already.
        """
        if not parcels.sampled:
            return parcels
        if parcels.extent is not None:
            raise MediumError("kernel: the parcels are clouds already, and were moved for it")
        place = parcels.position_m.copy()
        covariance = np.zeros((len(place), 3, 3))
        held = parcels.droplets > 0
        # Neighbours are places: many parcels in one place would only be each other's.
        there, which = np.unique(place[held], axis=0, return_inverse=True)
        if len(there) > 1:
            moved, spread = self._clouds(there)
            place[held], covariance[held] = moved[which], spread[which]
        return replace(parcels, position_m=place, extent=Cloud(covariance))

    def _clouds(self, there: Floats) -> tuple[Floats, Floats]:
        """Where each of some places (N, 3) moves, and its covariance (N, 3, 3)."""
        count = min(self.neighbours, len(there))
        most = _WIDEST**2 * float(there.var(axis=0).sum())
        tree = cKDTree(there)
        moved, covariance = np.empty_like(there), np.empty((len(there), 3, 3))
        for start in range(0, len(there), _AT_ONCE):
            mine = slice(start, start + _AT_ONCE)
            around = there[tree.query(there[mine], count, workers=-1)[1]]
            mean = around.mean(axis=1)
            apart = around - mean[:, None]
            spread = np.matmul(apart.transpose(0, 2, 1), apart) / (count - 1)
            trace = np.trace(spread, axis1=1, axis2=2)
            even = trace[:, None, None] / 3 * np.eye(3)
            width2 = np.minimum(self.width**2, most / trace)
            covariance[mine] = width2[:, None, None] * ((1 - _ROUND) * spread + _ROUND * even)
            # One far from all others is no gradient: it moves by less than they are wide.
            step = mean - there[mine]
            step *= np.minimum(1.0, np.sqrt(trace) / np.maximum(_length(step), 1e-30))[:, None]
            moved[mine] = there[mine] + width2[:, None] / 2 * step
        return moved, covariance


def _length(vector: Floats) -> Floats:
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", vector, vector)))


def halves(parcels: Parcels, *, seed: int) -> tuple[Parcels, Parcels]:
    """Two sprays of half of the parcels each, drawn at random, each with the liquid of all.

    Spread each half anew: clouds that were made of all parcels have followed their chance already,
    and halves of them differ by too little (`variants`).

    Args:
        parcels: to be halved.
        seed: of the draw.

    Returns:
        Both halves.

    Raises:
        MediumError: the parcels are no sample, but fill boxes; or fewer than two have droplets.
    """
    if not parcels.sampled:
        raise MediumError("halves: these parcels are no sample; their sampling error is 0")
    held = np.flatnonzero(parcels.droplets > 0)
    if len(held) < 2:
        raise MediumError(f"halves: {len(held)} parcels with droplets, at least 2 are needed")
    first = np.zeros(len(parcels.droplets), bool)
    first[np.random.default_rng(seed).permutation(held)[: len(held) // 2]] = True
    whole = parcels.mass_kg

    def weighted(half: Parcels) -> Parcels:
        # By mass and not by 2: the whole spray's mass is known, and has no error by sampling.
        return replace(half, droplets=half.droplets * (whole / half.mass_kg))

    return weighted(parcels.take(first)), weighted(parcels.take(~first))


@dataclass(frozen=True)
class Variants:
    """What shows the error of a spray's parcels, each of them to be traced as any spray.

    whole: all parcels, as clouds. halves: of `halves`, each spread anew. narrower: clouds of half
    of the variance. SAMPLING times the RMS difference of the halves' pictures is the whole's error
    by sampling; 4/3 of (whole - narrower) is about the bias of the width, which falls with its
    fourth power, and the noise that the narrower clouds add: an upper bound.
    """

    whole: Spray
    halves: tuple[Spray, Spray]
    narrower: Spray


def variants(spray: Spray, *, kernel: Kernel, seed: int) -> Variants:
    """Makes the variants of a spray whose parcels are a sample, in points.

    Args:
        spray: with points.
        kernel: that spreads them.
        seed: of the halves.

    Raises:
        MediumError: the spray has no parcels, or they are no sample, or clouds already.
    """
    if spray.parcels is None:
        raise MediumError("variants: the spray has no parcels")
    whole = kernel.spread(spray.parcels)
    first, second = (kernel.spread(half) for half in halves(spray.parcels, seed=seed))
    narrow = replace(kernel, width=kernel.width / 2**0.5).spread(spray.parcels)
    return Variants(
        whole=replace(spray, parcels=whole),
        halves=(replace(spray, parcels=first), replace(spray, parcels=second)),
        narrower=replace(spray, parcels=narrow),
    )
