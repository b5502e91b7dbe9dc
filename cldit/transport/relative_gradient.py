"""Gradient of the extinction within cells, found from their neighbours.

All coefficients of a cell vary together, k(x) = k_mean (1 + g . (x - x_c)): its mean is kept, and
so are albedo and emission per extinction. Along each axis g is the central difference, limited by
twice the one-sided ones and 0 where these differ in sign (monotonized central limiter: van Leer, J.
Comput. Phys. 23, 1977). So no value beyond those of the neighbours is made up: an even block stays
even up to its sides. Then g is shortened where k would be below 0 at a corner of the cell.

A neighbour of another size counts at the distance of its middle; an empty one is empty next to the
cell as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.medium.frame import BRICK
from cldit.medium.octree import Octree

Reals = NDArray[np.floating]
_CELLS = BRICK**3
# Least extinction at a corner, over the mean: rounding of places in a cube of 1024 cells is 1e-4.
LEAST = 2.0**-10


def limited(middle: Reals, below: Reals, above: Reals, *, down: Reals, up: Reals) -> Reals:
    """Limited slope along one axis.

    Args:
        middle, below, above: of a cell and its two neighbours, of one shape.
        down, up: distances to the neighbours' middles in the cell's edges, which broadcast.

    Returns:
        Change per edge of the cell.
    """
    first, second = (middle - below) / down, (above - middle) / up
    central = (first * up + second * down) / (down + up)
    # Half an edge from the middle lies the side, where no neighbour's value is passed.
    most = 2.0 * np.minimum(np.abs(middle - below), np.abs(above - middle))
    return np.where((first > 0) == (second > 0), np.clip(central, -most, most), 0.0)


def relative_gradient(tree: Octree, depth: Reals) -> NDArray[np.float32]:
    """Relative gradient of a coefficient in all stored cells and coarse leaves.

    Args:
        tree: where they lie.
        depth: (P,) the coefficient, 0 or more.

    Returns:
        (P, 3) along x, y, z, per finest cell; 0 in empty cells, and in coarse leaves that fill the
        cube.
    """
    out = np.zeros((len(depth), 3), np.float32)
    if not depth.any():
        return out
    fine = tree.slots * _CELLS
    if tree.slots:
        out[:fine] = _positive(depth[:fine], _stored(tree, depth)).T
    out[fine:] = _coarse(tree, depth)
    return out


def _positive(depth: Reals, slopes: Reals) -> Reals:
    """Slopes (3, N) over the mean (N,), shortened where a corner would be below LEAST of it."""
    safe = np.where(depth > 0, depth, 1.0)
    relative = np.where(depth > 0, slopes / safe, 0.0)
    reach = np.abs(relative).sum(axis=0) / 2
    return np.asarray(relative / np.maximum(reach / (1.0 - LEAST), 1.0))


def _stored(tree: Octree, depth: Reals) -> Reals:
    """Limited slopes (3, N) of stored cells, per edge."""
    values = depth[: tree.slots * _CELLS].reshape(-1, BRICK, BRICK, BRICK)
    at = np.empty((tree.slots, 3), np.int64)  # z, y, x
    there = tree.directory >= 0
    at[tree.directory[there]] = np.argwhere(there)
    padded = np.pad(tree.directory, 1, constant_values=-1)  # empty outside
    spans = np.maximum(1, tree.frame.cells >> tree.coarse_level)
    out = np.empty((3, *values.shape), depth.dtype)
    for axis in range(3):
        along = np.moveaxis(values, 1 + axis, 1)
        near, far = [], []
        for side in (0, 1):
            beside = at + 1
            beside[:, axis] += 2 * side - 1
            entry = padded[tuple(beside.T)]
            inner, leaf = entry >= 0, -1 - entry[entry < 0]
            ends = np.empty((tree.slots, BRICK, BRICK), depth.dtype)
            ends[inner] = along[entry[inner], 0 if side else -1]
            ends[~inner] = depth[tree.slots * _CELLS + leaf, None, None]
            distance = np.ones((tree.slots, BRICK, 1, 1), depth.dtype)
            distance[~inner, -1 if side else 0, 0, 0] = np.where(
                depth[tree.slots * _CELLS + leaf] > 0, (1 + spans[leaf]) / 2, 1.0
            )
            parts = [along[:, 1:], ends[:, None]] if side else [ends[:, None], along[:, :-1]]
            near.append(np.concatenate(parts, axis=1))
            far.append(distance)
        slope = limited(along, *near, down=far[0], up=far[1])
        out[2 - axis] = np.moveaxis(slope, 1, 1 + axis)
    return out.reshape(3, -1)


def _coarse(tree: Octree, depth: Reals) -> Reals:
    """Relative gradient (L, 3) of coarse leaves, per finest cell."""
    fine, levels = tree.slots * _CELLS, tree.coarse_level
    out = np.zeros((len(levels), 3))
    means = np.empty(tree.directory.shape)
    there = tree.directory >= 0
    side = min(BRICK, tree.frame.cells)
    bricks = depth[:fine].reshape(-1, BRICK, BRICK, BRICK)[:, :side, :side, :side]
    means[there] = bricks.mean(axis=(1, 2, 3))[tree.directory[there]]
    means[~there] = depth[fine - 1 - tree.directory[~there]]
    spans = np.ones(tree.directory.shape, np.int64)  # of each brick's leaf, in bricks
    spans[~there] = np.maximum(1, tree.frame.bricks >> levels[-1 - tree.directory[~there]])
    edge = 1  # of the leaves, in bricks
    while edge < tree.frame.bricks:
        number = -1 - tree.directory[::edge, ::edge, ::edge]
        mine = (spans[::edge, ::edge, ::edge] == edge) & (number >= 0)
        count = len(number)
        blocks = means.reshape(count, edge, count, edge, count, edge).mean(axis=(1, 3, 5))
        mine &= blocks > 0
        if mine.any():
            padded = np.pad(blocks, 1)
            wide = np.maximum(spans[::edge, ::edge, ::edge] // edge, 1)
            wide = np.pad(np.where(blocks > 0, wide, 1), 1, constant_values=1)
            at = np.argwhere(mine) + 1
            slopes = np.empty((3, len(at)))
            for axis in range(3):
                step = np.eye(3, dtype=np.int64)[axis]
                low, high = tuple((at - step).T), tuple((at + step).T)
                slopes[2 - axis] = limited(
                    blocks[mine],
                    padded[low],
                    padded[high],
                    down=(1 + wide[low]) / 2,
                    up=(1 + wide[high]) / 2,
                )
            out[number[mine]] = _positive(blocks[mine], slopes).T / (edge * side)
        edge *= 2
    return out
