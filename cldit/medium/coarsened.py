"""An octree on larger cells: means of its coefficients over blocks of finest cells."""

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Ints
from cldit.medium.frame import BRICK, CELLS_PER_BRICK
from cldit.medium.octree import Octree


def coarsened(tree: Octree, halvings: int) -> Octree:
    """The same medium in a cube that is halved `halvings` times less, at least three times.

    Integrals of all coefficients are conserved. A brick that contains a stored brick, or parts of
    several leaves, is stored. The number of leaves is not counted.
    """
    halvings = max(min(halvings, tree.frame.depth - 3, 3), 0)
    if halvings == 0:
        return tree
    frame, fold = tree.frame.at(tree.frame.depth - halvings), 1 << halvings
    number, levels = tree.directory, tree.coarse_level
    blocks = _blocks(number, fold)
    first = blocks[..., :1]
    stored = (blocks >= 0).any(axis=-1) | (blocks != first).any(axis=-1)
    # Leaves of at least one new brick stay; the first are empty space, one for each level.
    empty, filled = frame.depth + 1, tree.frame.depth + 1
    kept = np.flatnonzero(levels[filled:] <= frame.depth - 3) + filled
    renamed = np.arange(len(levels))
    renamed[kept] = empty + np.arange(len(kept))
    directory = np.where(stored, 0, -1 - renamed[np.maximum(-1 - first[..., 0], 0)])
    slots = int(stored.sum())
    directory[stored] = np.arange(slots)
    z, y, x = np.nonzero(stored.repeat(fold, 0).repeat(fold, 1).repeat(fold, 2))
    old = number[z, y, x]
    places = (directory[z // fold, y // fold, x // fold], z % fold, y % fold, x % fold)
    fine, coarse = tree.slots * CELLS_PER_BRICK, slots * CELLS_PER_BRICK

    def filled_with(values: NDArray[np.floating]) -> NDArray[np.floating]:
        side = BRICK // fold
        means = values[:fine].reshape(-1, side, fold, side, fold, side, fold).mean(axis=(2, 4, 6))
        leaf = values[fine + np.maximum(-1 - old, 0)][:, None, None, None]
        parts = np.where((old >= 0)[:, None, None, None], means[np.maximum(old, 0)], leaf)
        out = np.zeros(coarse + empty + len(kept), values.dtype)
        view = out[:coarse].reshape(-1, fold, side, fold, side, fold, side)
        slot, up, along, across = places
        view[slot, up, :, along, :, across, :] = parts
        out[coarse + empty :] = values[fine + kept]
        return out

    fields = {name: filled_with(values) for name, values in tree.fields.items()}
    shares = None
    if tree.shares is not None:
        scattering = tree.fields["droplet_scattering"]
        total = fields["droplet_scattering"]
        safe = np.where(total > 0, total, 1.0)
        rounded = [np.rint(filled_with(scattering * share) / safe) for share in tree.shares]
        shares = np.stack(rounded).astype(np.uint8)
    return Octree(
        frame=frame,
        directory=directory.astype(np.int32),
        slots=slots,
        coarse_level=np.concatenate([np.arange(empty), levels[kept]]).astype(np.int32),
        fields=fields,
        leaves=(),
        shares=shares,
    )


def _blocks(values: NDArray[np.int32], edge: int) -> Ints:
    """Values (n, n, n) in blocks of edge^3: (m, m, m, edge^3)."""
    count = len(values) // edge
    view = values.reshape(count, edge, count, edge, count, edge).transpose(0, 2, 4, 1, 3, 5)
    return np.asarray(view.reshape(count, count, count, edge**3))
