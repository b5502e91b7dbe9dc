"""Cells that the plumes of a `cone` spray fill, with the state of their mixture.

The cells are those of a cubic lattice. Near the holes a plume is narrower than a few of them: there
each is divided into 8, 64 or 512 parts, until `ACROSS` of their edges fit the radius of the
narrowest plume. State and evaporation are those of the parts, which a cell of the lattice averages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Ints
from cldit.gpu.device import Device
from cldit.io.free_memory import parts
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.jet import profile
from cldit.spray.cone.mixing import bilinear
from cldit.spray.cone.nozzle import NozzleFlow, nozzle_flow
from cldit.spray.cone.plumes import XI2, Plume, plumes_of, shares_of

NEGLIGIBLE = 1e-7  # share of the fuel in the thinnest cells, which the others receive
ACROSS = 4.0  # cells in the radius of the plume, as far as `DEEPEST` halvings allow
DEEPEST = 3  # halvings of a cell of the lattice


@dataclass(frozen=True)
class PlumeCells:
    """Cells of the lattice with fuel, and their parts.

    cell: (C, 3) from the nozzle. start: (C,) the first part of each cell. mass_kg: (N,) fuel.
    content_kg_m3: (N,) fuel in the share of the part that plumes fill. kinetic: (N,) share of the
    fuel that has had time to evaporate (the mean if several plumes fill the part).
    """

    cell: Ints
    start: Ints
    mass_kg: Floats
    content_kg_m3: Floats
    kinetic: Floats

    def total(self, amount: Floats) -> Floats:
        """Sums (C,) over the parts of each cell of an amount (N,)."""
        return np.asarray(np.add.reduceat(amount, self.start))

    def mean(self, value: Floats, weight: Floats) -> Floats:
        """Means (C,) of a value (N,) over the parts of each cell; 0 where the weight (N,) is."""
        sums = self.total(weight)
        return np.divide(self.total(value * weight), sums, out=np.zeros_like(sums), where=sums > 0)


_Run = tuple[Ints, Ints, Floats, Floats, Floats]


def plume_cells(spec: ConeSpray, device: Device, *, injected: float) -> PlumeCells:
    """Cells that the plumes of a spray fill with the `injected` fuel, in order."""
    source = nozzle_flow(spec, device)
    shares, plumes = shares_of(spec), plumes_of(spec, device)
    edge_m = spec.lattice_m
    radii = [ACROSS * edge_m / 2**halvings for halvings in range(DEEPEST)]
    reaches = (max(plume.distance_m(radius) for plume in plumes) / edge_m for radius in radii)
    # Cells within reach k of the nozzle, in edges, are halved k + 1 times or more.
    halved_within = [reach for reach in reaches if reach > 0]
    runs = [_filled(plume, source, edge_m, halved_within) for plume in plumes]
    cells = [cell for cell, *_ in runs]
    masses = [
        amount * (share * injected / amount.sum())
        for share, (_, _, amount, *_) in zip(shares, runs, strict=True)
    ]
    low = np.min([cell.min(axis=1) for cell in cells], axis=0)
    shape = tuple(np.max([cell.max(axis=1) for cell in cells], axis=0) - low + 1)
    finest = 8**DEEPEST
    joined = np.concatenate(
        [
            np.ravel_multi_index(tuple(cell - low[:, None]), shape) * finest + part
            for cell, part, *_ in runs
        ]
    )
    # The cells of each plume are mostly sorted: a stable sort merges them.
    order = np.argsort(joined, kind="stable")
    joined = joined[order]
    new = np.append(True, joined[1:] != joined[:-1])
    keys, place = joined[new], np.cumsum(new) - 1

    def summed(values: list[Floats]) -> Floats:
        return np.bincount(place, np.concatenate(values)[order]).astype(float, copy=False)

    mass = summed(masses)
    filled, kinetic = (
        summed([amount * run[column] for amount, run in zip(masses, runs, strict=True)]) / mass
        for column in (3, 4)
    )
    kept = np.delete(np.arange(len(mass)), thinnest(mass, NEGLIGIBLE * injected))
    mass = mass[kept] * (injected / mass[kept].sum())
    keys = keys[kept] // finest
    start = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    cell = np.stack(np.unravel_index(keys[start], shape)) + low[:, None]
    volume = edge_m**3 / 8.0 ** _halvings(cell, halved_within)
    content = mass / (filled[kept] * np.repeat(volume, np.diff(np.append(start, len(mass)))))
    return PlumeCells(cell.T, start, mass, content, np.minimum(kinetic[kept], 1.0))


def thinnest(amount: Floats, limit: float) -> Ints:
    """Indices of the smallest of amounts (N,) whose sum is at most `limit`."""
    bound = min(float(amount.max()), limit)  # no single larger amount
    fewer = amount[amount <= bound]
    # Only the few amounts below a bound, whose sum exceeds `limit`, are sorted.
    while bound > 0 and (fewer := fewer[fewer <= bound / 2]).sum() > limit:
        bound /= 2
    among = np.flatnonzero(amount <= bound)
    # A stable sort chooses among equal cells independently of the processor.
    order = among[np.argsort(amount[among], kind="stable")]
    return np.asarray(order[np.cumsum(amount[order]) <= limit])


def _halvings(cell: Ints, halved_within: Sequence[float]) -> Ints:
    """Number of times (N,) that cells (3, N) are halved."""
    r2 = np.sum((cell + 0.5) ** 2, axis=0)
    return np.asarray(np.count_nonzero(r2 < np.square(halved_within)[:, None], axis=0))


def _filled(
    plume: Plume, source: NozzleFlow, edge_m: float, halved_within: Sequence[float]
) -> _Run:
    """Parts of cells that one plume fills: cell (3, N), number in it, and three values (N,).

    These are the fuel in kg, the filled share, and the share of the fuel that has had time to
    evaporate. Where the plume is finer than the parts it is widened, and fills less of them
    accordingly, so that a coarse grid increases neither entrainment nor evaporation.
    """
    runs = [
        run
        for halvings in range(len(halved_within) + 1)
        for run in _in_parts(plume, source, edge_m, halved_within, halvings)
    ]
    cell, *columns = zip(*runs, strict=True)
    part, amount, filled, kinetic = (np.concatenate(column) for column in columns)
    return np.concatenate(cell, axis=1), part, amount, filled, kinetic


def _in_parts(
    plume: Plume, source: NozzleFlow, edge_m: float, halved_within: Sequence[float], halvings: int
) -> Iterator[_Run]:
    """Yields the parts of cells that are halved so many times, as `_filled`, slab by slab."""
    h = edge_m / 2**halvings
    width_m = plume.width_m(h)
    # A cell whose middle is near the nozzle reaches beyond it by less than its edge.
    within_m = (halved_within[halvings - 1] + 1) * edge_m if halvings else np.inf
    lower, upper = plume.box_m(h, within_m)
    most_m = float(np.max(width_m + np.linalg.norm(plume.aside_m, axis=1)))
    low, high = np.floor(lower / h).astype(np.int64), np.ceil(upper / h).astype(np.int64)
    slabs = max(1, sum(1 for _ in parts(int(np.prod(high - low)))))  # processed in the cache
    for x in np.array_split(np.arange(low[0], high[0]), slabs):
        if not x.size:
            continue
        # Most cells are beside the plume: coordinates are combined only for those within.
        ranges = (x, np.arange(low[1], high[1]), np.arange(low[2], high[2]))
        centre = [(index + 0.5) * h for index in np.ix_(*ranges)]
        s = sum(a * c for a, c in zip(plume.axis, centre, strict=True))
        r2 = sum(c * c for c in centre) - s * s
        end = plume.projected_m[-1]
        at = np.flatnonzero((s > 0) & (s < end) & (r2 < most_m**2))
        box = s.shape
        s, r2 = s.reshape(-1)[at], r2.reshape(-1)[at]
        s = np.interp(s, plume.projected_m, plume.along_m)
        width = np.interp(s, plume.along_m, width_m)
        for coordinate, aside in zip(centre, plume.aside_m.T, strict=True):
            moved = np.interp(s, plume.along_m, aside)
            r2 += moved * (moved - 2 * np.broadcast_to(coordinate, box).reshape(-1)[at])
        xi2 = np.maximum(r2, 0.0) / width**2
        place = [indices[i] for indices, i in zip(ranges, np.unravel_index(at, box), strict=True)]
        cell = np.stack([index >> halvings for index in place])
        inside = (xi2 < 1) & (_halvings(cell, halved_within) == halvings)
        s, xi2, width, cell = s[inside], xi2[inside], width[inside], cell[:, inside]
        ratio = plume.jet.axis_ratio(s) * profile(np.sqrt(xi2))
        filled = (np.interp(s, plume.along_m, plume.radius_m) / width) ** 2
        kinetic, part = bilinear(plume.along_m, XI2, plume.fuel, s, xi2)
        amount = source.mixture.content(ratio, kinetic) * filled * part * h**3
        x_, y_, z_ = (
            fine[inside] - (coarse << halvings) for fine, coarse in zip(place, cell, strict=True)
        )
        number = (((x_ << halvings) + y_) << halvings) + z_
        present = amount > 0
        yield cell[:, present], number[present], amount[present], filled[present], kinetic[present]
