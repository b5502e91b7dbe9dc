"""Linear reconstruction of gas on a lattice, before an octree takes it.

Number density and temperature have a gradient in every box, from its six neighbours (monotonized
central limiter), and the box is divided into parts with their values. The vapour of a box and its
mean temperature are kept, and no part is outside the range of the box and its neighbours. Where
there is no neighbour there is no vapour; beside boxes of another size nothing is known, and the
gradient across that face is 0.
"""

from itertools import product

import numpy as np

from cldit.arrays import Floats, Ints
from cldit.medium.limiter import limited
from cldit.spray.result import Cells, Vapour

FINEST_m = 0.5e-3  # boxes of at most this edge are not divided
_MOST = 4  # parts along an edge
_MOST_BOXES = 8_000_000  # of eight doubles each: half a gigabyte
_SIZES = 16  # boxes of more sizes are on no lattice
_OFF = 1e-3  # of an edge: largest distance of a box from its place


def reconstructed(vapour: Vapour) -> Vapour:
    """Vapour in parts of its boxes of at most `FINEST_m`, or a fourth of a box; as it is where
    boxes are on no lattice."""
    cells = vapour.cells
    if not len(cells.lower_m):
        return vapour
    edges = cells.upper_m - cells.lower_m
    scale = float(edges.max())
    if scale <= FINEST_m * (1 + _OFF):
        return vapour
    _, sizes = np.unique(np.round(edges / (_OFF * scale)), axis=0, return_inverse=True)
    count = int(sizes.max()) + 1
    if count > _SIZES:
        return vapour
    boxes = [np.flatnonzero(sizes == size) for size in range(count)]
    parts = [_of_one_size(vapour, chosen, uniform=count == 1) for chosen in boxes]
    if len(parts) == 1:
        return parts[0]
    return Vapour(
        cells=Cells(
            np.concatenate([part.cells.lower_m for part in parts]),
            np.concatenate([part.cells.upper_m for part in parts]),
        ),
        number_density_m3=np.concatenate([part.number_density_m3 for part in parts]),
        temperature_K=np.concatenate([part.temperature_K for part in parts]),
        molar_mass_kg_mol=vapour.molar_mass_kg_mol,
    )


def coarsened(vapour: Vapour) -> Vapour | None:
    """Vapour in boxes twice as large, its content and mean temperature kept; None: no lattice."""
    lower, upper = vapour.cells.lower_m, vapour.cells.upper_m
    if not len(lower):
        return None
    origin, edge = lower.min(axis=0), (upper - lower).mean(axis=0)
    steps = (lower - origin) / edge
    place = np.rint(steps).astype(np.int64)
    if max(np.abs(steps - place).max(), np.abs((upper - lower) / edge - 1).max()) > _OFF:
        return None
    shape = tuple(int(end) for end in place.max(axis=0) // 2 + 1)
    key = np.ravel_multi_index(tuple(place.T // 2), shape)
    voxel, box = np.unique(key, return_inverse=True)
    number = np.bincount(box, vapour.number_density_m3)
    heat = np.bincount(box, vapour.number_density_m3 * vapour.temperature_K)
    filled = number > 0
    cells = Cells.regular(
        origin_m=origin,
        spacing_m=2 * edge,
        shape=(shape[0], shape[1], shape[2]),
        index=voxel[filled],
    )
    number, heat = number[filled], heat[filled]
    return Vapour(cells, number / 8, heat / number, vapour.molar_mass_kg_mol)


def _of_one_size(vapour: Vapour, chosen: Ints, *, uniform: bool) -> Vapour:
    """Reconstruction of the `chosen` boxes, of one size; `uniform`: no box has another size."""
    lower, upper = vapour.cells.lower_m[chosen], vapour.cells.upper_m[chosen]
    density, temperature = vapour.number_density_m3[chosen], vapour.temperature_K[chosen]
    same = Vapour(Cells(lower, upper), density, temperature, vapour.molar_mass_kg_mol)
    origin, edge = lower.min(axis=0), (upper - lower).mean(axis=0)
    parts = _parts(float(edge.max()), len(chosen))
    steps = (lower - origin) / edge
    place = np.rint(steps).astype(np.int64)
    if parts == 1 or np.abs(steps - place).max() > _OFF:
        return vapour if uniform else same
    shape = (place.max(axis=0) + 3).tolist()  # with an empty layer on all sides
    key = np.ravel_multi_index(tuple(place.T + 1), shape)
    order = np.argsort(key)
    if np.any(np.diff(key[order]) == 0):  # boxes in one place
        return vapour if uniform else same
    sides = _neighbours(key, order, shape)
    steps_in = (np.arange(parts) + 0.5) / parts - 0.5
    reach, square = float(steps_in[-1]), float(np.mean(steps_in**2))
    n = _linear(density, sides, np.zeros(len(key)) if uniform else density, reach, None)
    relative = square * n / np.maximum(density, np.finfo(float).tiny)
    # The mean temperature by number: what the products of both gradients add is subtracted.
    t = _linear(temperature, sides, temperature, reach, relative)
    extra = np.einsum("an,an->n", relative, t)
    offsets = np.array(list(product(steps_in, repeat=3)))
    numbers = np.maximum(np.concatenate([density + offset @ n for offset in offsets]), 0.0)
    warm = np.concatenate([temperature - extra + offset @ t for offset in offsets])
    fine = np.concatenate(
        [place * parts + np.rint((o + 0.5) * parts - 0.5).astype(np.int64) for o in offsets]
    )
    grid = tuple(int(end) for end in (place.max(axis=0) + 1) * parts)
    cells = Cells.regular(
        origin_m=origin,
        spacing_m=edge / parts,
        shape=(grid[0], grid[1], grid[2]),
        index=np.ravel_multi_index(tuple(fine.T), grid),
    )
    return Vapour(cells, numbers, warm, vapour.molar_mass_kg_mol)


def _parts(edge_m: float, boxes: int) -> int:
    limit = int((_MOST_BOXES / boxes) ** (1 / 3))
    return max(1, min(_MOST, limit, int(np.ceil(edge_m / FINEST_m - _OFF))))


def _neighbours(key: Ints, order: Ints, shape: list[int]) -> list[tuple[Ints, Ints]]:
    """Number (N,) of the neighbour below and above along x, y, z; -1: there is none."""
    keys = key[order]
    neighbours = []
    for step in (shape[1] * shape[2], shape[2], 1):
        pair = []
        for sought in (key - step, key + step):
            at = np.minimum(np.searchsorted(keys, sought), len(keys) - 1)
            pair.append(np.where(keys[at] == sought, order[at], -1))
        neighbours.append((pair[0], pair[1]))
    return neighbours


def _linear(
    value: Floats,
    sides: list[tuple[Ints, Ints]],
    outside: Floats,
    middle_reach: float,
    shift: Floats | None,
) -> Floats:
    """Gradient (3, N) per edge of a value (N,); a missing neighbour has the value `outside`.

    No part, up to `middle_reach` edges from the middle, is outside the range of box and neighbours,
    even if all are shifted by the product of the gradient with `shift` (3, N).
    """
    beside = [[np.where(at >= 0, value[at], outside) for at in pair] for pair in sides]
    slopes = np.stack([limited(value, *pair, down=1.0, up=1.0) for pair in beside])
    values = [value, *(side for pair in beside for side in pair)]
    room = np.minimum(np.max(values, axis=0) - value, value - np.min(values, axis=0))
    reach = middle_reach * np.abs(slopes).sum(axis=0)
    if shift is not None:
        reach += np.abs(np.einsum("an,an->n", slopes, shift))
    beyond = reach > room
    return np.asarray(slopes * np.where(beyond, room / np.where(beyond, reach, 1.0), 1.0))
