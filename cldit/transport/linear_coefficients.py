"""Coefficients that are linear within cells, for all rays but those of the sweeps.

The absorption of vapour and the absorption and scattering of droplets have a gradient each,
k(x) = k_mean (1 + g . (x - x_c)), found from the neighbours. Along an axis g is the central
difference, limited to twice the one-sided differences, and 0 where these differ in sign
(monotonized central limiter: van Leer, J. Comput. Phys. 23, 1977). No value beyond those of the
neighbours arises: a uniform block stays uniform up to its sides. Then g is shortened where k would
be negative at a corner of the cell. A neighbour of another size counts at the distance of its
middle; an empty one is empty next to the cell as well.

The extinction is the sum of the three. Emission over extinction and albedo vary within the cell as
well: T_app, in which the extinction nearly cancels, would not gain otherwise. They are linear too,
to first order. Their values in the middle are set so that a cell emits and scatters as its means
say: the mean of (1 + g . x)(S + s . x) is S + g . s / 12.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Reals
from cldit.medium.frame import BRICK
from cldit.medium.limiter import limited
from cldit.medium.octree import Octree
from cldit.transport.discrete_ordinates.limiter import limit

# As |g| is 2 at most, a value of |s| up to 3/2 S has 3/4 S in the middle at least, and falls by 3/4
# S to a corner: to 0, not below.
MOST = 4.0 / 3.0
# Least extinction at a corner, over the mean: rounding of places in a cube of 1024 cells is 1e-4.
LEAST = 2.0**-10
_EXTINCTION = ("vapour_absorption", "droplet_absorption", "droplet_scattering")
_MEAN = 1.0 / 12.0  # of x^2 in a cell of edge 1
_TOGETHER = 2**18  # cells, for memory
_CELLS = BRICK**3


@dataclass(frozen=True)
class LinearCoefficients:
    """Gradients (P, 3) along x, y, z, per finest cell, of stored cells and coarse leaves.

    extinction: relative to its mean.
    albedo: gradient of the scattered share of the extinction.
    emission: (E, P, 3) gradient of each emitter's emission over extinction.
    edge: (P,) edge of the cell or leaf, in finest cells.
    """

    extinction: Reals
    albedo: Reals
    emission: Reals
    edge: Reals

    @classmethod
    def of(cls, tree: Octree, albedo: Reals, emitted: Mapping[str, Reals]) -> "LinearCoefficients":
        """Gradients of a tree with the albedo (P,) and emission over extinction (P,) by emitter."""
        fields = tree.fields
        whole = np.sum([fields[name] for name in _EXTINCTION], axis=0)
        safe = np.where(whole > 0, whole, np.float32(1))[:, None]
        gradients = {name: relative_gradient(tree, fields[name]) for name in _EXTINCTION}
        extinction = np.zeros((len(whole), 3), np.float32)
        for name, gradient in gradients.items():
            extinction += fields[name][:, None] / safe * gradient
        edge = np.ones(len(whole), np.float32)
        edge[-len(tree.coarse_level) :] = tree.frame.cells >> tree.coarse_level
        change = np.zeros((3, 1 + len(emitted), len(whole)), np.float32)
        mean = np.stack([albedo, *emitted.values()]).astype(np.float32)
        change[:, 0] = mean[0] * (gradients["droplet_scattering"] - extinction).T
        for number, name in enumerate(emitted, 1):
            field = fields["vapour_emission" if name == "vapour" else "droplet_emission"]
            change[:, number] = mean[number] * (relative_gradient(tree, field) - extinction).T
        for first in range(0, len(whole), _TOGETHER):
            some = slice(first, first + _TOGETHER)
            part = change[:, :, some] * edge[some]
            # The albedo stays within 0..1. All gradients of a cell shrink by one factor, so that
            # they still sum to 0 in an isothermal cavity.
            reach = np.abs(part[:, 0]).sum(axis=0) * np.float32(MOST / 2)
            room = (1 - mean[0, some]) / np.maximum(reach, np.float32(1e-20))
            part *= np.clip(room, 0, 1)
            limit(part, mean[:, some] / np.float32(MOST), 1)
            change[:, :, some] = part / edge[some]
        return cls(extinction, change[:, 0].T, change[:, 1:].transpose(1, 2, 0), edge)

    def excess(self, gradient: Reals) -> Reals:
        """Extinction-weighted mean less the middle value (P,), of gradients (P, 3)."""
        product = np.einsum("pi,pi->p", self.extinction, gradient)
        return np.asarray(product * self.edge**2 * np.float32(_MEAN))


def relative_gradient(tree: Octree, depth: Reals) -> NDArray[np.float32]:
    """Relative gradient (P, 3) along x, y, z, per finest cell, of a coefficient (P,) >= 0.

    It is 0 in empty cells and in coarse leaves that fill the cube.
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
    """Slopes (3, N) over the mean (N,), shortened so that corners are at least LEAST of it."""
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
