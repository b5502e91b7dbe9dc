"""Division of the cube into the leaves of an octree, and their values from finest cells."""

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask
from cldit.medium.deposit import Directory
from cldit.medium.frame import BRICK, CELLS_PER_BRICK, Cube


def _blocks(values: NDArray[np.generic], edge: int) -> NDArray[np.generic]:
    """View of (S, 8, 8, 8) values as blocks of edge^3: (S, n, edge, n, edge, n, edge)."""
    count = BRICK // edge
    return values.reshape(-1, count, edge, count, edge, count, edge)


_IN_BLOCK = (2, 4, 6)  # axes of that view inside a block, and inside a brick
_IN_BRICK = tuple(range(1, 7))


@dataclass(frozen=True)
class Division:
    """Division of the cube, and leaf of every finest cell.

    touched: slot of each brick that contains anything. keep: that of every stored one. coarse,
    member: mask (nb, nb, nb) of bricks in a coarse leaf, and the leaf's number; filled: coarse
    leaves that are not empty. unsplit: blocks of cells in stored bricks that are one leaf, (edge,
    mask).
    """

    frame: Cube
    touched: Directory
    directory: NDArray[np.int32]
    keep: NDArray[np.int32]
    coarse: Mask
    member: Ints
    filled: Mask
    coarse_level: NDArray[np.int32]
    unsplit: list[tuple[int, Mask]]
    leaves: tuple[int, ...]

    @classmethod
    def of(
        cls, frame: Cube, touched: Directory, fields: list[dict[str, Floats]], bound: float
    ) -> "Division":
        """Top-down division of the cube, the same for all wavelengths.

        `fields` has those of the finest cells (S * 512,) of each wavelength, and `bound` is the
        optical depth above which a cube of vapour is halved.
        """
        shape = (-1, BRICK, BRICK, BRICK)
        vapour = reduce(np.maximum, (f["vapour_absorption"] for f in fields)).reshape(shape)
        wet = (f["droplet_absorption"] + f["droplet_scattering"] > 0 for f in fields)
        droplets = reduce(np.logical_or, wet).reshape(shape)
        leaves = [0] * (frame.depth + 1)
        inside = _inside(frame)

        mark = touched >= 0
        brick_vapour = np.zeros(mark.shape)
        brick_droplets = np.zeros(mark.shape, bool)
        brick_vapour[mark] = vapour[inside].mean(axis=(1, 2, 3))
        brick_droplets[mark] = droplets[inside].any(axis=(1, 2, 3))
        parent, level, split = _coarse_levels(frame, brick_vapour, brick_droplets, bound, leaves)

        # Undivided bricks become coarse leaves, as do those of a larger leaf.
        stored = mark & (split | (frame.depth == 0))  # a tree of one cell has it in a brick
        directory = np.full(mark.shape, -1, np.int32)
        keep = touched[stored]
        directory[stored] = np.arange(len(keep), dtype=np.int32)
        coarse = ~stored
        used, member = np.unique(parent[coarse], return_inverse=True)
        filled = np.bincount(member, brick_vapour[coarse] + brick_droplets[coarse], len(used)) > 0
        empty = frame.depth + 1  # the first coarse leaves: empty space of every level
        node_level = np.zeros(len(used), np.int32)
        node_level[member] = level[coarse]
        index = node_level.copy()
        index[filled] = empty + np.arange(int(filled.sum()), dtype=np.int32)
        directory[coarse] = -1 - index[member]
        unsplit = _merge_in_bricks(frame, vapour, droplets, keep, bound, leaves)
        return cls(
            frame=frame,
            touched=touched,
            directory=directory,
            keep=keep,
            coarse=coarse,
            member=member,
            filled=filled,
            coarse_level=np.concatenate([np.arange(empty), node_level[filled]]).astype(np.int32),
            unsplit=unsplit,
            leaves=tuple(leaves),
        )

    def fill(self, data: Floats) -> NDArray[np.float32]:
        """Values (P,) of a field, in the tree's addresses, from the finest cells (S * 512,)."""
        fine, empty = len(self.keep) * CELLS_PER_BRICK, self.frame.depth + 1
        values = np.zeros(fine + empty + int(self.filled.sum()), np.float32)
        if not data.any():
            return values
        bricks = data.reshape(-1, BRICK, BRICK, BRICK)
        # Coarse leaves have the mean of their bricks; bricks without a slot are empty.
        slots = self.touched[self.coarse]
        present = slots >= 0
        total = np.zeros(len(slots))
        total[present] = bricks[slots[present]][_inside(self.frame)].mean(axis=(1, 2, 3))
        members = np.bincount(self.member, minlength=len(self.filled))
        means = np.bincount(self.member, total, len(members)) / members
        values[fine + empty :] = means[self.filled]
        cells = bricks[self.keep]
        for side, block in self.unsplit:
            partial = np.flatnonzero(block.any(axis=_IN_BRICK))
            part = cells[partial]
            view = _blocks(part, side)
            np.copyto(view, view.mean(axis=_IN_BLOCK, keepdims=True), where=block[partial])
            cells[partial] = part
        values[:fine] = cells.reshape(-1)
        return values


def _inside(frame: Cube) -> tuple[slice, slice, slice, slice]:
    """Used part of (S, 8, 8, 8): a cube of fewer than eight cells is one partly used brick."""
    used = slice(0, min(BRICK, frame.cells))
    return slice(None), used, used, used


def _coarse_levels(
    frame: Cube,
    vapour: Floats,
    droplets: Mask,
    bound: float,
    leaves: list[int],
) -> tuple[Ints, NDArray[np.int32], Mask]:
    """Divides from the cube down to bricks.

    Returns (nb, nb, nb) arrays: number and level of the leaf that covers a brick, and the mask of
    bricks that are divided further (which have no such leaf).
    """
    pyramid = [(vapour, droplets)]
    while pyramid[-1][0].shape[0] > 1:
        v, d = pyramid[-1]
        half = v.shape[0] // 2
        v = v.reshape(half, 2, half, 2, half, 2).mean(axis=(1, 3, 5))
        d = np.asarray(d.reshape(half, 2, half, 2, half, 2).any(axis=(1, 3, 5)))
        pyramid.append((v, d))
    number = np.zeros((1, 1, 1), np.int64)
    covering = np.zeros((1, 1, 1), np.int32)
    open_ = np.ones((1, 1, 1), bool)
    following = 1
    for level, (v, d) in enumerate(reversed(pyramid)):
        edge_m = frame.at(level).cell_m
        finest = level == frame.depth
        divide = open_ & (d | (v * edge_m > bound)) & (not finest)
        closed = open_ & ~divide
        leaves[level] += int(closed.sum())
        number[closed] = following + np.arange(int(closed.sum()))
        following += int(closed.sum())
        covering[closed] = level
        if v.shape[0] == frame.bricks:
            return number, covering, divide
        number = number.repeat(2, 0).repeat(2, 1).repeat(2, 2)
        covering = covering.repeat(2, 0).repeat(2, 1).repeat(2, 2)
        open_ = divide.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    raise AssertionError("the pyramid ends at the bricks")


def _merge_in_bricks(
    frame: Cube,
    vapour: Floats,
    droplets: Mask,
    keep: NDArray[np.int32],
    bound: float,
    leaves: list[int],
) -> list[tuple[int, Mask]]:
    """Blocks of 4^3 and 2^3 cells in divided bricks that are one leaf: (edge, mask)."""
    edge = min(BRICK, frame.cells)
    level = frame.depth - edge.bit_length() + 1
    open_: Mask | None = None
    merged: list[tuple[int, Mask]] = []
    side = edge // 2
    while side >= 1:
        level += 1
        if open_ is None:
            count = edge // side
            present = np.zeros((len(keep), *(BRICK // side, 1) * 3), bool)
            present[:, :count, :, :count, :, :count] = True
        else:
            present = open_.repeat(2, 1).repeat(2, 3).repeat(2, 5)
        if side == 1:  # a finest cell is always a leaf
            leaves[level] += int(present.sum())
            break
        blocks = _blocks(droplets[keep], side)
        divide = np.asarray(blocks.any(axis=_IN_BLOCK, keepdims=True), bool)
        dry = np.flatnonzero(~divide.all(axis=_IN_BRICK))  # few bricks have parts without droplets
        v = _blocks(vapour[keep[dry]], side).mean(axis=_IN_BLOCK, keepdims=True)
        divide[dry] |= v * side * frame.cell_m > bound
        divide &= present
        closed = present & ~divide
        leaves[level] += int(closed.sum())
        merged.append((side, closed))
        open_ = divide
        side //= 2
    return merged
