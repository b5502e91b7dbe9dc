"""Leaves of an octree as boxes: position, size, and address of the value."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Ints, Mask
from cldit.medium.frame import BRICK, CELLS_PER_BRICK
from cldit.medium.octree import Octree


@dataclass(frozen=True)
class Leaves:
    """Boxes that fill the cube without a gap.

    corner: (N, 3; x, y, z) lower corner in finest cells of the cube. edge: (N,) in finest cells.
    address: (N,) of the leaf's value in the tree's fields.
    """

    corner: Ints
    edge: Ints
    address: Ints

    @classmethod
    def of(cls, tree: Octree, values: Sequence[NDArray[np.generic]]) -> "Leaves":
        """Leaves on which all of some fields (P,), without NaN, are constant.

        A tree stores the finest cells of a divided brick. Those of a block of 2^3, 4^3 or 8^3 that
        agree in every field are one leaf here.
        """
        fine, coarse = _stored(tree, values), _coarse(tree)
        return cls(*(np.concatenate(pair) for pair in zip(fine, coarse, strict=True)))

    def nodes(self, cells: int) -> tuple[Ints, Ints]:
        """Corners (P, 3; x, y, z) of the leaves, in finest cells, and those of each leaf (N, 8).

        They are in the order of VTK's hexahedron; the cube has `cells` finest cells along an edge.
        """
        across = cells + 1
        places = self.corner[:, None] + self.edge[:, None, None] * _HEXAHEDRON
        keys = (places[..., 2] * across + places[..., 1]) * across + places[..., 0]
        keys, node = np.unique(keys.reshape(-1), return_inverse=True)
        points = np.stack([keys % across, keys // across % across, keys // across**2], axis=1)
        return points, node.reshape(-1, 8)


_HEXAHEDRON = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)

_Parts = tuple[Ints, Ints, Ints]


def _stored(tree: Octree, values: Sequence[NDArray[np.generic]]) -> _Parts:
    """Corner, edge and address of the leaves in divided bricks."""
    z, y, x = np.nonzero(tree.directory >= 0)
    order = np.argsort(tree.directory[z, y, x])
    brick = np.stack([x, y, z], axis=1)[order].astype(np.int64) * BRICK
    used = min(BRICK, tree.frame.cells)
    edge = np.ones((tree.slots, BRICK, BRICK, BRICK), np.int64)
    alike = np.ones_like(edge, dtype=bool)
    side = 2
    while side <= used:
        alike = _blocks_alike(tree, values, side)
        edge[alike] = side
        side *= 2
    place = np.indices((BRICK, BRICK, BRICK)).transpose(1, 2, 3, 0)  # z, y, x
    corner = np.all(place % edge[..., None] == 0, axis=-1) & np.all(place < used, axis=-1)
    slot, lz, ly, lx = np.nonzero(corner)
    inside = np.stack([lx, ly, lz], axis=1)
    address = slot * CELLS_PER_BRICK + (lz * BRICK + ly) * BRICK + lx
    return brick[slot] + inside, edge[corner], address


def _blocks_alike(tree: Octree, values: Sequence[NDArray[np.generic]], side: int) -> Mask:
    """Mask (S, 8, 8, 8) of the cells whose block of `side`^3 cells has equal values."""
    count = BRICK // side
    shape = (tree.slots, count, side, count, side, count, side)
    alike = np.ones((tree.slots, count, 1, count, 1, count, 1), bool)
    for field in values:
        blocks = field[: tree.slots * CELLS_PER_BRICK].reshape(shape)
        alike &= (blocks == blocks[:, :, :1, :, :1, :, :1]).all(axis=(2, 4, 6), keepdims=True)
    return np.broadcast_to(alike, shape).reshape(tree.slots, BRICK, BRICK, BRICK)


def _coarse(tree: Octree) -> _Parts:
    """Corner, edge and address of the leaves of a brick or larger, including empty ones."""
    z, y, x = np.nonzero(tree.directory < 0)
    index = -1 - tree.directory[z, y, x].astype(np.int64)
    edge = tree.frame.cells >> tree.coarse_level[index].astype(np.int64)
    corner = np.stack([x, y, z], axis=1).astype(np.int64) * BRICK
    corners = np.all(corner % np.maximum(edge, 1)[:, None] == 0, axis=1)
    return corner[corners], edge[corners], tree.slots * CELLS_PER_BRICK + index[corners]
