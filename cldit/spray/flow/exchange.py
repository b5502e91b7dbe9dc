"""Exchange between parcels and the grid of rays: trilinear, with equal weights both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Ints
from cldit.spray.flow.advection import mix
from cldit.spray.flow.rays import RayGrid
from cldit.spray.numba_typing import compiled

SPOT = 0.02  # standard deviation of a parcel's droplets, over the distance from the tip


@dataclass(frozen=True)
class Places:
    """Eight cells (N, 8) around each position, flat, and their weights; and the turns (N,) with
    which a position is folded into the grid: cosine, sine, and sign of the second axis."""

    cell: Ints
    weight: Floats
    cosine: Floats
    sine: Floats
    sign: Floats


def places(grid: RayGrid, position_m: Floats) -> Places:
    """Places in the grid of positions (N, 3) from the injector's tip."""
    count = len(position_m)
    found = Places(
        np.empty((count, 8), dtype=np.int64),
        np.empty((count, 8)),
        np.empty(count),
        np.empty(count),
        np.empty(count),
    )
    _place(
        np.ascontiguousarray(position_m @ grid.frame.T),
        grid.azimuth,
        grid.polar,
        grid.radius_m,
        grid.symmetry,
        found.cell,
        found.weight,
        found.cosine,
        found.sine,
        found.sign,
    )
    return found


def gather(at: Places, field: Floats) -> Floats:
    """Values (N,) of a field of the grid's shape."""
    result = np.empty(len(at.cell))
    _gather(at.cell, at.weight, field.reshape(-1), result)
    return result


def scatter(grid: RayGrid, at: Places, *amounts: Floats) -> Floats:
    """Amounts, each (N,), of one plume of equal ones, or of all, as fields per volume (S, ...).

    A parcel represents droplets around it. So what it gives is spread across the rays by `SPOT`, by
    what diffuses in a step, which keeps content and sign. Linear weights alone spread it by 0.4
    cells, so that finer cells would see single parcels.
    """
    fields = np.zeros((len(amounts), *grid.shape))
    for field, amount in zip(fields, amounts, strict=True):
        _scatter(at.cell, at.weight, amount, field.reshape(-1))
    fields /= grid.volume_m3 * (grid.copies / max(grid.symmetry, 1))
    around, down, _ = grid.conductance
    polar, radius = grid.middle[1:]
    wide = np.diff(grid.azimuth)[:, None] * np.sin(polar)
    for axis, conductance, size in ((1, down, np.diff(grid.polar)), (0, around, wide)):
        if grid.shape[axis] > 1:
            half = np.broadcast_to(0.5 * np.maximum(SPOT**2 - size**2 / 6, 0.0), grid.shape[:2])
            mix(
                fields,
                grid.volume_m3.copy(),
                np.zeros(grid.shape),
                half[:, :, None] * radius**2,
                conductance,
                grid.strip_m2 / radius,
                1.0,
                axis == 0,
            )
    return fields


def folded(grid: RayGrid, at: Places, vectors: Floats) -> Floats:
    """Vectors (N, 3) in the grid's frame, turned with their position into its sector."""
    x, y, z = (vectors @ grid.frame.T).T
    across = at.sign * (at.cosine * y - at.sine * x)
    if grid.symmetry == 0:
        across = np.zeros_like(across)  # cancels in the mean around the axis
    return np.stack([at.cosine * x + at.sine * y, across, z], axis=1)


def unfolded(grid: RayGrid, at: Places, vectors: Floats) -> Floats:
    """Inverse of `folded`."""
    x, y, z = vectors.T
    y = at.sign * y
    there = np.stack([at.cosine * x - at.sine * y, at.sine * x + at.cosine * y, z], axis=1)
    return np.asarray(there @ grid.frame)


@compiled
def between(faces: Floats, x: float) -> tuple[int, int, float]:
    """Two neighbouring cells, and the weight of the second."""
    count = len(faces) - 1
    low, high = 0, count
    while high - low > 1:
        half = (low + high) // 2
        if faces[half] <= x:
            low = half
        else:
            high = half
    part = min(max((x - faces[low]) / (faces[low + 1] - faces[low]), 0.0), 1.0)
    at = min(max(low + part - 0.5, 0.0), count - 1.0)
    first = min(int(at), max(count - 2, 0))
    return first, min(first + 1, count - 1), at - first


@compiled
def turn_of(symmetry: int, angle: float) -> float:
    """Angle by which to turn a position into the sector of the cells."""
    if symmetry == 0:
        return angle
    if symmetry == 1:
        return 0.0
    sector = 2 * np.pi / symmetry
    return float(sector * np.floor(angle / sector + 0.5))


@compiled
def _place(
    position: Floats,
    azimuth: Floats,
    polar: Floats,
    radius: Floats,
    symmetry: int,
    cell: Ints,
    weight: Floats,
    cosine: Floats,
    sine: Floats,
    sign: Floats,
) -> None:
    for n in range(position.shape[0]):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        flat = np.sqrt(x * x + y * y)
        angle = np.arctan2(y, x)
        turn = turn_of(symmetry, angle)
        angle -= turn
        cosine[n], sine[n], sign[n] = np.cos(turn), np.sin(turn), 1.0
        if symmetry > 1 and angle < 0:
            sign[n] = -1.0
            angle = -angle
        around = between(azimuth, angle)
        down = between(polar, np.arctan2(flat, z))
        outward = between(radius, np.sqrt(flat * flat + z * z))
        corners(around, down, outward, len(polar) - 1, len(radius) - 1, cell[n], weight[n])


@compiled
def corners(
    around: tuple[int, int, float],
    down: tuple[int, int, float],
    outward: tuple[int, int, float],
    polar: int,
    radius: int,
    cell: Ints,
    weight: Floats,
) -> None:
    """Writes the eight cells around a position, of a grid of so many in angle and radius."""
    a, ap, u = around
    t, tp, v = down
    i, ip, w = outward
    for c in range(8):
        k = ap if c & 4 else a
        j = tp if c & 2 else t
        m = ip if c & 1 else i
        cell[c] = (k * polar + j) * radius + m
        share = (u if c & 4 else 1 - u) * (v if c & 2 else 1 - v)
        weight[c] = share * (w if c & 1 else 1 - w)


@compiled
def _gather(cell: Ints, weight: Floats, field: Floats, result: Floats) -> None:
    for n in range(cell.shape[0]):
        total = 0.0
        for c in range(8):
            total += weight[n, c] * field[cell[n, c]]
        result[n] = total


@compiled
def _scatter(cell: Ints, weight: Floats, values: Floats, field: Floats) -> None:
    for n in range(cell.shape[0]):
        for c in range(8):
            field[cell[n, c]] += weight[n, c] * values[n]
