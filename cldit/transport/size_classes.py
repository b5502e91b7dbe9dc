"""Classes of droplet size, as few as a spray needs, each with a mean phase function.

One mean phase function for all cells is exact if the mixture of sizes is the same everywhere. The
deviation from that determines the number of classes: neighbouring parcels form a group, and the
phase function of each group is compared with that of the classes and their shares in the group.
The distance of two phase functions is

    sqrt(2 integral (F - G)^2 d cosine)

where F and G are the shares scattered into larger cosines. It is at least the difference of the
two asymmetries, which is the integral of F - G.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import ScatteringTable, SizeClasses, cosine_bounds

MOST_CLASSES = 8
# Tolerated RMS distance of the groups' phase functions. For two sprays with droplets of 18 and 2 um
# in different places it was 0.17 and 0.24, and the RMS error of T_app with one phase function for
# all cells was 1.9 and 3.1 K (walls at 300 K, background at 400 K): 0.01 is about 0.1 K.
TOLERATED = 0.01
_GROUP, _MOST_GROUPS = 32, 4096  # fewest parcels of a group, and largest number of groups
_EVERY = 16  # bins of the phase function between the compared bounds


@dataclass(frozen=True)
class _Groups:
    """Scattering by groups of neighbouring parcels.

    share: (B, S) of a group's scattering by bins of size. square: (B, S) sums of the squares of the
    parcels' shares; 0 if parcels are not a sample. weight: (B,) share of all scattering.
    """

    share: Floats
    square: Floats
    weight: Floats

    @classmethod
    def of(
        cls,
        position_m: Floats,
        scattering_m2: Floats,
        number: NDArray[np.intp],
        *,
        bins: int,
        sampled: bool,
    ) -> "_Groups":
        position, weight = position_m, scattering_m2
        if not np.all(weight > 0):
            scatters = weight > 0
            position, weight, number = position[scatters], weight[scatters], number[scatters]
        order = np.argsort(_morton(position), kind="stable")
        count = int(np.clip(len(order) // _GROUP, 1, _MOST_GROUPS))
        group = np.empty(len(order), np.intp)
        group[order] = np.arange(len(order)) * count // len(order)
        total = np.bincount(group, weight, count)
        at, size = group * bins + number, count * bins
        part = weight / total[group]
        share = np.asarray(np.bincount(at, part, size), np.float64).reshape(count, bins)
        square = np.zeros_like(share)
        if sampled:
            parcels = np.bincount(group, minlength=count)
            # Bessel's correction of a sample's variance, n / (n - 1).
            bessel = (parcels / np.maximum(parcels - 1, 1))[group]
            square[:] = np.bincount(at, bessel * part**2, size).reshape(count, bins)
        return cls(share, square, total / total.sum())

    def distance(self, deviations: Floats) -> float:
        """RMS length of the groups' means of vectors (S, A), which sum to 0 over the spray.

        For a sample, the mean square that chance alone would give is subtracted.
        """
        means = self.share @ deviations
        lengths = np.sum(means**2, axis=1)
        chance = self.square @ np.sum(deviations**2, axis=1) + np.sum(self.square, axis=1) * lengths
        chance -= 2 * np.sum((self.square @ deviations) * means, axis=1)
        return float(np.sqrt(max(self.weight @ (lengths - chance), 0.0)))


def _morton(position: Floats) -> NDArray[np.int32]:
    """Numbers (N,) of places (N, 3) along the Morton curve; neighbours mostly are consecutive."""
    numbers = np.arange(1024, dtype=np.int32)
    spread = np.zeros_like(numbers)  # a number's bits, three apart
    for bit in range(10):
        spread |= (numbers >> bit & 1) << 3 * bit
    out = np.zeros(len(position), np.int32)
    axes = [np.ascontiguousarray(axis) for axis in position.T]
    size = max(*(float(np.ptp(axis)) for axis in axes), 1e-300)
    for number, axis in enumerate(axes):
        place = ((axis - axis.min()) * (1024 / size)).astype(np.int32)
        out |= spread[np.minimum(place, 1023)] << number
    return out


def in_size_classes(
    mean: ScatteringTable,
    bins: SizeBins,
    *,
    position_m: Floats,
    diameter_m: Floats,
    scattering_m2: Floats,
    sampled: bool,
    tolerated: float = TOLERATED,
) -> ScatteringTable:
    """Phase function with the fewest classes that describe the places of a spray, or with none.

    Args:
        position_m, diameter_m, scattering_m2: (N, 3), (N,) and (N,) of the parcels.
        sampled: true if the parcels are a sample of the droplets, so that groups also differ by
            chance.
        tolerated: RMS distance of phase functions at which no class is added.
    """
    groups = _Groups.of(
        position_m,
        scattering_m2,
        bins.number(diameter_m),
        bins=len(bins.share),
        sampled=sampled,
    )
    solved = np.flatnonzero(bins.solved)
    share = bins.share[solved]
    cosine = cosine_bounds()[::_EVERY]
    light = np.cumsum(bins.within[:, solved] / bins.within[:, solved].sum(axis=0), axis=0)
    reached = np.vstack([np.zeros(len(solved)), light])[::_EVERY].T
    # Vectors whose squares sum to twice the integral over the cosine (midpoints of the bins).
    step = np.gradient(-np.arange(len(cosine)), cosine) ** -1
    reached = reached * np.sqrt(2 * step)
    costs = _costs(reached, share)
    best_classes: SizeClasses | None = None
    least_distance = np.inf
    for count in range(1, min(MOST_CLASSES, len(solved)) + 1):
        starts = _partition(costs, count)
        deviations = np.zeros((len(bins.share), reached.shape[1]))
        for first, end in zip(starts, [*starts[1:], len(solved)], strict=True):
            middle = np.average(reached[first:end], axis=0, weights=share[first:end])
            deviations[solved[first:end]] = reached[first:end] - middle
        distance = groups.distance(deviations)
        # Possible, since classes are chosen by all droplets, not by groups.
        if distance >= least_distance:
            continue
        least_distance = distance
        if count > 1:
            first_bins = [0, *(int(solved[start]) for start in starts[1:])]
            ends = [*first_bins[1:], len(bins.share)]
            tables = [bins.mean(*pair) for pair in zip(first_bins, ends, strict=True)]
            best_classes = SizeClasses(bins.edges_m[first_bins[1:]], tuple(tables), distance)
        if distance <= tolerated:
            break
    return replace(mean, classes=best_classes)


def _costs(reached: Floats, share: Floats) -> Floats:
    """Scatter about their mean of the vectors (S, A) first..end - 1, as [first, end]."""
    sums = np.vstack([np.zeros(reached.shape[1]), np.cumsum(share[:, None] * reached, axis=0)])
    weight = np.append(0.0, np.cumsum(share))
    square = np.append(0.0, np.cumsum(share * np.sum(reached**2, axis=1)))
    count = len(share)
    out = np.full((count, count + 1), np.inf)
    for start in range(count):
        end = np.arange(start + 1, count + 1)
        total = np.sum((sums[end] - sums[start]) ** 2, axis=1)
        out[start, end] = square[end] - square[start] - total / (weight[end] - weight[start])
    return out


def _partition(costs: Floats, classes: int) -> list[int]:
    """First members of contiguous classes with the smallest sum of `costs`, exactly."""
    count = len(costs)
    best = np.full((classes + 1, count + 1), np.inf)
    best[0, 0] = 0.0
    came = np.zeros((classes + 1, count + 1), np.intp)
    for number in range(1, classes + 1):
        totals = best[number - 1, :count, None] + costs
        came[number] = np.argmin(totals, axis=0)
        best[number] = np.min(totals, axis=0)
    starts, end = [], count
    for number in range(classes, 0, -1):
        end = int(came[number, end])
        starts.append(end)
    return starts[::-1]
