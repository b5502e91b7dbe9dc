"""A sample of the lines along which the camera looks through a spray, as columns of fuel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.spray.result import Spray

Floats = NDArray[np.float64]

_ACROSS = 40  # pixels of the coarse picture, each way
_LINES = 48
_SLICES = 12  # along a line: fuel is cold in the middle of a plume and hot around it
_SIZES = 6
_MOLE = 6.02214076e23
_TYPICAL_m2_mol = 30.0  # to sort lines by thickness; any fuel's C-H band, in order of magnitude
_THIN = 0.05  # optical depth below which a line is left out, unless all are


@dataclass(frozen=True)
class Sightlines:
    """L lines along the camera's axis, from thin to thick, in Y slices from the camera on.

    vapour_mol_m2, vapour_K (L, Y): column and its mean temperature; droplet_m2 (L, Y, D): geometric
    cross section of the droplets of each size per area; diameter_m (D,); droplet_K (L, Y).
    """

    vapour_mol_m2: Floats
    vapour_K: Floats
    droplet_m2: Floats
    diameter_m: Floats
    droplet_K: Floats

    def __len__(self) -> int:
        return len(self.vapour_mol_m2)

    @classmethod
    def through(cls, spray: Spray) -> Sightlines:
        """Lines through a spray with parcels or vapour."""
        places, moles, gas_K = np.zeros((0, 3)), np.zeros(0), np.zeros(0)
        if spray.vapour is not None:
            cells = spray.vapour.cells
            places = (cells.lower_m + cells.upper_m) / 2.0
            moles = spray.vapour.number_density_m3 * cells.volume_m3 / _MOLE
            gas_K = spray.vapour.temperature_K
        spots, areas, sizes, drop_K = np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0)
        if spray.parcels is not None:
            parcels = spray.parcels
            spots, sizes = parcels.position_m, parcels.diameter_m
            areas = parcels.droplets * sizes**2 * (np.pi / 4.0)
            drop_K = parcels.temperature_K
        everything = np.concatenate([places[moles > 0], spots[areas > 0]])
        low, high = everything.min(axis=0), everything.max(axis=0)
        shape = np.array([_ACROSS, _SLICES, _ACROSS])
        pitch = np.maximum((high - low) / shape, 1e-6)

        def add(at: Floats, amount: Floats) -> Floats:
            """(pixels, Y) sums per area."""
            x, y, z = np.clip(((at - low) / pitch).astype(int), 0, shape - 1).T
            place = (x * _ACROSS + z) * _SLICES + y
            total = np.bincount(place, amount, int(np.prod(shape))) / (pitch[0] * pitch[2])
            return np.asarray(total.reshape(-1, _SLICES))

        vapour, warm = add(places, moles), add(places, moles * gas_K)
        bounds, diameter = _sizes(sizes, areas)
        which = np.searchsorted(bounds, sizes)
        drops = np.zeros((_ACROSS**2, _SLICES, len(diameter)))
        for size in range(len(diameter)):
            drops[..., size] = add(spots[which == size], areas[which == size])
        drops_warm, wet = add(spots, areas * drop_K), drops.sum(axis=2)
        depth = (vapour * _TYPICAL_m2_mol + 2.0 * wet).sum(axis=1)
        order = np.argsort(depth, kind="stable")
        seen = order[depth[order] > min(_THIN, 0.5 * float(depth.max()))]
        take = seen[np.linspace(0, len(seen) - 1, min(_LINES, len(seen))).round().astype(int)]
        return cls(
            vapour_mol_m2=vapour[take],
            vapour_K=_mean(warm[take], vapour[take]),
            droplet_m2=drops[take],
            diameter_m=diameter,
            droplet_K=_mean(drops_warm[take], wet[take]),
        )


def _mean(weighted: Floats, weight: Floats) -> Floats:
    """Weighted temperatures over their weights; 300 K where there is nothing to weigh."""
    return np.where(weight > 0, weighted / np.where(weight > 0, weight, 1.0), 300.0)


def _sizes(diameter_m: Floats, area_m2: Floats) -> tuple[Floats, Floats]:
    """Bounds between classes of equal area, and each class's area-weighted mean diameter."""
    if not np.any(area_m2 > 0):
        return np.zeros(0), np.zeros(0)
    order = np.argsort(diameter_m)
    share = np.cumsum(area_m2[order]) / area_m2.sum()
    bounds = np.unique(np.interp(np.arange(1, _SIZES) / _SIZES, share, diameter_m[order]))
    which = np.searchsorted(bounds, diameter_m)
    total = np.bincount(which, area_m2, len(bounds) + 1)
    mean = np.bincount(which, area_m2 * diameter_m, len(bounds) + 1)
    full = np.where(total > 0, total, 1.0)
    middle = np.where(total > 0, mean / full, diameter_m.max())
    return bounds, middle
