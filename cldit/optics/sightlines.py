"""A sample of lines of sight through a spray, as columns of fuel.

The lines are adjacent beams as wide as the finest cells of the trace, so that they resolve the
spray as the trace does. The content of a box is shared among beams and slices by overlap, that of a
point is in one beam. Columns times beam areas add up to the whole content.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask
from cldit.constants import AVOGADRO_PER_MOL
from cldit.medium.deposit import PlacedBoxes
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.spray.extent import Box, Cloud
from cldit.spray.result import Parcels, Spray, Vapour

_ACROSS = 256  # beams each way at most: 50 MB for each amount
_BINS = 14  # of equal width in depth and in temperature, whose lines are alike
_SLICES = 24  # along a line: fuel is cold in the middle of a plume and hot around it
_SIZES = 6  # classes of droplets, of equal area
_TYPICAL_m2_mol = 30.0  # to sort lines by thickness; any fuel's C-H band, in order of magnitude


@dataclass(frozen=True)
class Sightlines:
    """L lines along the camera's axis, from thin to thick, in Y slices from the camera on.

    vapour_mol_m2, vapour_K (L, Y): column and its mean temperature; droplet_m2 (L, Y, D): geometric
    cross section of the droplets of each size per area; diameter_m (D,); droplet_K (L, Y); count
    (L,): number of the spray's lines that each represents.
    """

    vapour_mol_m2: Floats
    vapour_K: Floats
    droplet_m2: Floats
    diameter_m: Floats
    droplet_K: Floats
    count: Floats

    def __len__(self) -> int:
        return len(self.vapour_mol_m2)

    @classmethod
    def through(cls, spray: Spray, *, width_m: float) -> "Sightlines":
        """Lines through a spray with fuel, along beams of `width_m`, or wider for a large spray."""
        gas_m, mol, gas_K = _gas(spray.vapour)
        drops_m, area_m2, drops_K, diameter_m = _droplets(spray.parcels)
        beams = Beams.around(*np.concatenate([gas_m, drops_m], axis=1), width_m=width_m)
        vapour, warm = beams.columns(gas_m[0], gas_m[1], [mol, mol * gas_K])
        bounds, diameter = _sizes(diameter_m, area_m2)
        number = np.searchsorted(bounds, diameter_m)
        sizes = (np.where(number == size, area_m2, 0.0) for size in range(len(diameter)))
        *classes, drops_warm = beams.columns(drops_m[0], drops_m[1], [*sizes, area_m2 * drops_K])
        wet = sum(classes, np.zeros_like(vapour))
        depth = (vapour * _TYPICAL_m2_mol + 2.0 * wet).sum(axis=1)
        kelvin = _mean((warm * _TYPICAL_m2_mol + 2.0 * drops_warm).sum(axis=1), depth)
        take, count = _strata(depth, kelvin)
        droplet = np.zeros((len(take), beams.shape[1], len(diameter)))
        for size, column in enumerate(classes):
            droplet[..., size] = column[take]
        return cls(
            vapour_mol_m2=vapour[take],
            vapour_K=_mean(warm[take], vapour[take]),
            droplet_m2=droplet,
            diameter_m=diameter,
            droplet_K=_mean(drops_warm[take], wet[take]),
            count=count,
        )


def _strata(depth: Floats, kelvin: Floats) -> tuple[NDArray[np.intp], Floats]:
    """One of the (N,) lines of each class of depth and temperature, thin ones first, and the size
    of the classes: a few cold lines at the injector count as a few."""
    order = np.argsort(depth, kind="stable")
    # The emissivity of a thin line is its optical depth; lines are ignored below, unless all are.
    seen = order[depth[order] > min(VISIBLE_EMISSIVITY, 0.5 * float(depth.max()))]
    bins = [
        np.digitize(quantity, np.linspace(quantity.min(), quantity.max(), _BINS + 1)[1:-1])
        for quantity in (np.log(depth[seen]), kelvin[seen])
    ]
    classes, count = np.unique(bins[0] * _BINS + bins[1], return_counts=True)
    inside = (np.flatnonzero(bins[0] * _BINS + bins[1] == label) for label in classes)
    middle = np.array([members[len(members) // 2] for members in inside], np.intp)
    thin = np.argsort(middle)
    return seen[middle[thin]], count[thin].astype(float)


@dataclass(frozen=True)
class Beams:
    """Beams along y, side by side in x and z, cut into slices.

    lower_m, pitch_m (3,): low corner, and edges of a beam's slice along x, y, z; shape: beams along
    x, slices, beams along z.
    """

    lower_m: Floats
    pitch_m: Floats
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, lower_m: Floats, upper_m: Floats, *, width_m: float) -> "Beams":
        """Beams of `width_m` or wider through boxes or points with corners (N, 3)."""
        low, high = lower_m.min(axis=0), upper_m.max(axis=0)
        limit = np.array([_ACROSS, _SLICES, _ACROSS])
        shape = np.clip(np.floor((high - low) / width_m + 1e-6).astype(int), 1, limit)
        # Content narrower than a beam is at its centre, as it would be in one cell of the trace.
        pitch = np.maximum((high - low) / shape, width_m)
        middle = (low + high) / 2.0
        return cls(
            middle - pitch * shape / 2.0, pitch, (int(shape[0]), int(shape[1]), int(shape[2]))
        )

    def columns(self, lower_m: Floats, upper_m: Floats, amounts: Sequence[Floats]) -> list[Floats]:
        """Each amount per beam area, (beams, slices); with Z beams along z, number is x * Z + z.

        lower_m, upper_m: (N, 3) corners of boxes with uniform content; equal for points. amounts:
        (N,) each.
        """
        nx, ny, nz = self.shape
        sums = [np.zeros(nz * ny * nx) for _ in amounts]
        lower, upper = ((at - self.lower_m) / self.pitch_m for at in (lower_m, upper_m))
        points = np.any(upper <= lower, axis=1)
        if np.any(points):
            cell = self._place(np.floor((lower + upper)[points] / 2.0))
            for total, amount in zip(sums, amounts, strict=True):
                total += np.bincount(cell, amount[points], len(total))
        if not np.all(points):
            contents = [amount[~points] for amount in amounts]
            for box, cell, share in PlacedBoxes(lower[~points], upper[~points]).overlaps():
                place = self._place(cell)
                for total, content in zip(sums, contents, strict=True):
                    total += np.bincount(place, content[box] * share, len(total))
        area = self.pitch_m[0] * self.pitch_m[2]
        return [
            np.ascontiguousarray(total.reshape(nz, ny, nx).transpose(2, 0, 1)).reshape(-1, ny)
            / area
            for total in sums
        ]

    def _place(self, cell: NDArray[np.generic]) -> Ints:
        """Flat indices (N,) in [z, y, x] of cells (N, 3), clipped to the beams."""
        x, y, z = np.clip(cell.astype(np.int64), 0, np.array(self.shape) - 1).T
        return np.asarray((z * self.shape[1] + y) * self.shape[0] + x)


def _gas(vapour: Vapour | None) -> tuple[Floats, Floats, Floats]:
    """Corners (2, N, 3) of the cells with fuel, moles and temperatures (N,)."""
    if vapour is None:
        return np.zeros((2, 0, 3)), np.zeros(0), np.zeros(0)
    cells = vapour.cells
    mol = vapour.number_density_m3 * cells.volume_m3 / AVOGADRO_PER_MOL
    held = mol > 0
    corners_m = np.stack([cells.lower_m[held], cells.upper_m[held]])
    return corners_m, mol[held], vapour.temperature_K[held]


def _droplets(parcels: Parcels | None) -> tuple[Floats, Floats, Floats, Floats]:
    """Corners (2, N, 3) of boxes with uniform content, equal for points, of parcels with droplets;
    cross sections, temperatures and diameters (N,)."""
    if parcels is None:
        return np.zeros((2, 0, 3)), np.zeros(0), np.zeros(0), np.zeros(0)
    area_m2 = parcels.droplets * parcels.diameter_m**2 * (np.pi / 4.0)
    held = area_m2 > 0
    at, half = parcels.position_m[held], _half_edges(parcels, held)
    corners_m = np.stack([at - half, at + half])
    return corners_m, area_m2[held], parcels.temperature_K[held], parcels.diameter_m[held]


def _half_edges(parcels: Parcels, held: Mask) -> Floats:
    """Half edges (N, 3) of the parcels' boxes; a cloud's box has the variance of the cloud along
    each axis, that of a uniform box of edge h being h^2 / 12."""
    count = int(np.count_nonzero(held))
    match parcels.extent:
        case Box(edge_m):
            return np.broadcast_to(np.asarray(edge_m) / 2, (count, 3))
        case Cloud(covariance_m2):
            return np.sqrt(3.0 * np.diagonal(covariance_m2[held], axis1=1, axis2=2))
        case None:
            return np.zeros((count, 3))


def _mean(weighted: Floats, weight: Floats) -> Floats:
    """Weighted temperatures over their weights; 300 K where the weight is 0."""
    return np.where(weight > 0, weighted / np.where(weight > 0, weight, 1.0), 300.0)


def _sizes(diameter_m: Floats, area_m2: Floats) -> tuple[Floats, Floats]:
    """Bounds between classes of equal area, and each class's area-weighted mean diameter."""
    if not np.any(area_m2 > 0):
        return np.zeros(0), np.zeros(0)
    order = np.argsort(diameter_m)
    share = np.cumsum(area_m2[order]) / area_m2.sum()
    bounds = np.unique(np.interp(np.arange(1, _SIZES) / _SIZES, share, diameter_m[order]))
    size_class = np.searchsorted(bounds, diameter_m)
    total = np.bincount(size_class, area_m2, len(bounds) + 1)
    mean = np.bincount(size_class, area_m2 * diameter_m, len(bounds) + 1)
    full = np.where(total > 0, total, 1.0)
    middle = np.where(total > 0, mean / full, diameter_m.max())
    return bounds, middle
