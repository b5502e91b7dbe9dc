"""The octree: how finely each part of the cube is resolved, and what each leaf absorbs and emits.

Splitting follows the paper (Section "Ray Tracing"): a cube is halved while its vapour's optical
depth exceeds a bound or droplets are in it, until its edge is below the leaf edge. Leaves of one
finest cell are stored in bricks of 8^3 cells, so that kernels find them with two loads; a coarser
leaf is one value for all the bricks (or cells) that it covers.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.medium.deposit import Boxes, Placed, Touched, place_droplets, touched_bricks
from cldit.medium.frame import BRICK, Frame
from cldit.spray.extent import Extent

Floats = NDArray[np.float64]
_CELLS_PER_BRICK = BRICK**3
_TOGETHER = 4  # trees that are filled at a time, one a thread
# Absorption below this optical depth across the whole cube is taken for none: it is far below
# rounding in any picture, and its denormal numbers would slow every kernel that meets them.
_NOTHING = 1e-12
_CLASS = "droplet_scattering_"  # and the number of a class of size, while a tree is made

FIELDS = (
    "vapour_absorption",
    "vapour_emission",
    "droplet_absorption",
    "droplet_scattering",
    "droplet_emission",
)


@dataclass(frozen=True)
class PointSource:
    """Droplets in parcels: cross sections summed over a parcel's droplets, (N,) each.

    absorption_m2, scattering_m2: cross sections; emission_m2: absorption_m2 x photon radiance.
    extent: how they are spread about `position_m`; None: at it.
    class_scattering_m2: scattering_m2 of each class of droplet size but the first, (N,) each;
        empty: one class.
    """

    position_m: Floats
    absorption_m2: Floats
    scattering_m2: Floats
    emission_m2: Floats
    extent: Extent | None = None
    class_scattering_m2: tuple[Floats, ...] = ()

    @property
    def sections(self) -> dict[str, Floats]:
        """What is deposited in each field, m2 or emission times m2 (N,)."""
        return {
            "droplet_absorption": self.absorption_m2,
            "droplet_scattering": self.scattering_m2,
            "droplet_emission": self.emission_m2,
            **{f"{_CLASS}{k}": one for k, one in enumerate(self.class_scattering_m2, 1)},
        }


@dataclass(frozen=True)
class CellSource:
    """Coefficients in boxes, per metre, (N,) each; emission = absorption x photon radiance."""

    lower_m: Floats
    upper_m: Floats
    vapour_absorption: Floats
    vapour_emission: Floats
    droplet_absorption: Floats
    droplet_scattering: Floats
    droplet_emission: Floats


Sources = tuple[PointSource | None, list[CellSource]]


@dataclass(frozen=True)
class Octree:
    """Flat arrays of a built tree.

    directory: (nb, nb, nb) int32, [z, y, x]. d >= 0: the brick's cells are values[d * 512 + local],
        local = (z * 8 + y) * 8 + x. d < 0: all of the brick is in one coarse leaf, whose value is
        values[slots * 512 - 1 - d].
    coarse_level: level of every coarse leaf, so that a ray crosses it in one step. The first
        depth + 1 of them are empty space, one for each level.
    fields: one float32 array a name in FIELDS, coefficients per metre, emission in
        photons s-1 m-3 sr-1.
    leaves: how many leaves there are at each level, 0 (the cube) to depth.
    shares: (K - 1, P) uint8, for each of K classes of droplet size but the last what it and those
        before it scatter of all that droplets scatter, in 255ths; None: one class.
    """

    frame: Frame
    directory: NDArray[np.int32]
    slots: int
    coarse_level: NDArray[np.int32]
    fields: dict[str, NDArray[np.float32]]
    leaves: tuple[int, ...]
    shares: NDArray[np.uint8] | None = None

    @property
    def filled(self) -> NDArray[np.bool_]:
        """(nb, nb, nb), where a brick is not empty space."""
        return (self.directory >= 0) | (self.directory < -1 - self.frame.depth)

    @property
    def has_vapour(self) -> bool:
        """Whether any vapour absorbs."""
        return bool(np.any(self.fields["vapour_absorption"] > 0))

    @property
    def has_droplets(self) -> bool:
        """Whether any droplet absorbs or scatters."""
        absorbs = np.any(self.fields["droplet_absorption"] > 0)
        return bool(absorbs or np.any(self.fields["droplet_scattering"] > 0))

    def integral(self, name: str) -> float:
        """Field `name` integrated over the cube, m3 times the field's unit."""
        values = self.fields[name].astype(np.float64)
        fine = values[: self.slots * _CELLS_PER_BRICK].sum() * self.frame.cell_m**3
        coarse = -1 - self.directory[self.directory < 0]
        side = min(BRICK, self.frame.cells) * self.frame.cell_m
        return float(fine + values[self.slots * _CELLS_PER_BRICK + coarse].sum() * side**3)


def build_octree(
    frame: Frame,
    points: PointSource | None,
    cells: list[CellSource],
    *,
    optical_depth_split: float,
    max_cells: int = 60_000_000,
) -> Octree:
    """Deposits the sources and divides the cube.

    Args:
        frame: the cube.
        points: droplets.
        cells: gas.
        optical_depth_split: above which a cube of vapour is halved.
        max_cells: finest cells at most.

    Raises:
        MediumError: something lies outside the cube, or the tree exceeds `max_cells` finest cells.
    """
    return build_octrees(
        frame, [(points, cells)], optical_depth_split=optical_depth_split, max_cells=max_cells
    )[0]


def build_octrees(
    frame: Frame,
    sources: Sequence[Sources],
    *,
    optical_depth_split: float,
    max_cells: int = 60_000_000,
) -> list[Octree]:
    """One tree for each of several sets of coefficients of the same spray (wavelengths).

    Places are the first set's; all trees are divided alike, as the largest coefficients want it,
    and so have one set of addresses. Geometry is worked out once.

    Args:
        frame: the cube.
        sources: droplets and gas of each wavelength.
        optical_depth_split, max_cells: as in `build_octree`.

    Returns:
        One tree for each of `sources`.

    Raises:
        MediumError: as `build_octree`.
    """
    points, cells = sources[0]
    droplets: list[Placed] = []
    if points is not None:
        optical = points.absorption_m2 + points.scattering_m2
        droplets.append(place_droplets(frame, points.position_m, points.extent, optical))
    boxes = [Boxes.place(frame, source.lower_m, source.upper_m, what="gas") for source in cells]
    touched = touched_bricks(frame, [*droplets, *boxes], limit=max_cells)
    every = _deposit(frame, touched, droplets, boxes, sources)
    for fields in every:
        faint = fields["vapour_absorption"] * frame.edge_m < _NOTHING
        fields["vapour_absorption"][faint] = 0.0
        fields["vapour_emission"][faint] = 0.0
    division = _Division.of(frame, touched, every, optical_depth_split)
    if len(every) == 1:  # memory that a thread takes is not used again by others
        return [division.fill(every[0])]
    with ThreadPoolExecutor(_TOGETHER) as pool:
        return list(pool.map(division.fill, every))


def _deposit(
    frame: Frame,
    touched: Touched,
    droplets: list[Placed],
    boxes: list[Boxes],
    sources: Sequence[Sources],
) -> list[dict[str, Floats]]:
    size = touched.slots * _CELLS_PER_BRICK
    every = [
        {name: np.zeros(size) for name in (*FIELDS, *({} if one is None else one.sections))}
        for one, _ in sources
    ]
    volume = frame.cell_m**3
    for placed in droplets:
        targets, amounts = [], []
        for fields, (points, _) in zip(every, sources, strict=True):
            if points is not None:
                targets += [fields[name] for name in points.sections]
                amounts += [section / volume for section in points.sections.values()]
        placed.add(touched, amounts, targets)
    for number, box in enumerate(boxes):
        in_cells = np.prod(box.upper - box.lower, axis=1)
        targets, amounts = [], []
        for fields, (_, cells) in zip(every, sources, strict=True):
            for name in FIELDS:
                values = getattr(cells[number], name)
                if np.any(values):
                    targets.append(fields[name])
                    amounts.append(values * in_cells)
        box.add(touched, amounts, targets)
    return every


def _blocks(values: NDArray[np.generic], edge: int) -> NDArray[np.generic]:
    """View of (S, 8, 8, 8) values as blocks of edge^3: (S, n, edge, n, edge, n, edge)."""
    count = BRICK // edge
    return values.reshape(-1, count, edge, count, edge, count, edge)


_IN_BLOCK = (2, 4, 6)


@dataclass(frozen=True)
class _Division:
    """How the cube is divided, and where every value of the finest cells goes.

    keep: touched brick of every stored one. whole, member: bricks (nb, nb, nb) that lie in a coarse
    leaf, and which; filled: coarse leaves that hold something. unsplit: blocks of cells in stored
    bricks that stay one leaf, (edge, where).
    """

    frame: Frame
    touched: Touched
    directory: NDArray[np.int32]
    keep: NDArray[np.int32]
    whole: NDArray[np.bool_]
    member: NDArray[np.int64]
    filled: NDArray[np.bool_]
    coarse_level: NDArray[np.int32]
    unsplit: list[tuple[int, NDArray[np.bool_]]]
    leaves: tuple[int, ...]

    @classmethod
    def of(
        cls, frame: Frame, touched: Touched, every: list[dict[str, Floats]], bound: float
    ) -> _Division:
        """Top-down division of the cube by the sums of the finest cells."""
        shape = (touched.slots, BRICK, BRICK, BRICK)
        vapour = np.max([f["vapour_absorption"] for f in every], axis=0).reshape(shape)
        droplets = np.any(
            [f["droplet_absorption"] + f["droplet_scattering"] > 0 for f in every], axis=0
        ).reshape(shape)
        leaves = [0] * (frame.depth + 1)
        inside = _inside(frame)

        mark = touched.directory >= 0
        brick_vapour = np.zeros(mark.shape)
        brick_droplets = np.zeros(mark.shape, bool)
        brick_vapour[mark] = vapour[inside].mean(axis=(1, 2, 3))
        brick_droplets[mark] = droplets[inside].any(axis=(1, 2, 3))
        parent, level, split = _coarse_levels(frame, brick_vapour, brick_droplets, bound, leaves)

        # Bricks that stay whole become coarse leaves, as do those of a larger leaf.
        stored = mark & (split | (frame.depth == 0))  # a tree of one cell keeps it in a brick
        directory = np.full(mark.shape, -1, np.int32)
        keep = touched.directory[stored]
        directory[stored] = np.arange(len(keep), dtype=np.int32)
        whole = ~stored
        used, member = np.unique(parent[whole], return_inverse=True)
        filled = np.bincount(member, brick_vapour[whole] + brick_droplets[whole], len(used)) > 0
        empty = frame.depth + 1  # the first coarse leaves: empty space of every level
        node_level = np.zeros(len(used), np.int32)
        node_level[member] = level[whole]
        index = node_level.copy()
        index[filled] = empty + np.arange(int(filled.sum()), dtype=np.int32)
        directory[whole] = -1 - index[member]
        unsplit = _merge_in_bricks(frame, vapour, droplets, keep, bound, leaves)
        return cls(
            frame=frame,
            touched=touched,
            directory=directory,
            keep=keep,
            whole=whole,
            member=member,
            filled=filled,
            coarse_level=np.concatenate([np.arange(empty), node_level[filled]]).astype(np.int32),
            unsplit=unsplit,
            leaves=tuple(leaves),
        )

    def fill(self, fields: dict[str, Floats]) -> Octree:
        """The tree with one set of values."""
        shape = (self.touched.slots, BRICK, BRICK, BRICK)
        mark = self.touched.directory >= 0
        members = np.bincount(self.member, minlength=len(self.filled))
        values: dict[str, NDArray[np.float32]] = {}
        length = len(self.keep) * _CELLS_PER_BRICK + self.frame.depth + 1 + int(self.filled.sum())
        for name, data in fields.items():
            if not data.any():
                values[name] = np.zeros(length, np.float32)
                continue
            total = np.zeros(mark.shape)
            total[mark] = data.reshape(shape)[_inside(self.frame)].mean(axis=(1, 2, 3))
            means = np.bincount(self.member, total[self.whole], len(members)) / members
            cells = data.reshape(shape)[self.keep]
            for side, block in self.unsplit:
                view = _blocks(cells, side)
                mean = view.mean(axis=_IN_BLOCK, keepdims=True)
                np.copyto(view, mean, where=block)
            coarse = np.concatenate([np.zeros(self.frame.depth + 1), means[self.filled]])
            values[name] = np.concatenate([cells.reshape(-1), coarse]).astype(np.float32)
        classes = [values.pop(name) for name in list(values) if name.startswith(_CLASS)]
        return Octree(
            frame=self.frame,
            directory=self.directory,
            slots=len(self.keep),
            coarse_level=self.coarse_level,
            fields=values,
            leaves=self.leaves,
            shares=_cumulative(values["droplet_scattering"], classes) if classes else None,
        )


def _cumulative(
    total: NDArray[np.float32], classes: list[NDArray[np.float32]]
) -> NDArray[np.uint8]:
    """`Octree.shares` of what all classes, and each but the first, scatter (P,)."""
    above = np.cumsum(classes[::-1], axis=0)[::-1]  # of each class and those behind it
    share = np.divide(above, total, out=np.zeros_like(above), where=total > 0)
    return np.asarray(255 - np.rint(255 * np.clip(share, 0.0, 1.0))).astype(np.uint8)


def _inside(frame: Frame) -> tuple[slice, slice, slice, slice]:
    """The used part of (S, 8, 8, 8): a cube of fewer than eight cells is one brick, partly used."""
    used = slice(0, min(BRICK, frame.cells))
    return slice(None), used, used, used


def _coarse_levels(
    frame: Frame,
    vapour: Floats,
    droplets: NDArray[np.bool_],
    bound: float,
    leaves: list[int],
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.bool_]]:
    """Divides from the cube down to bricks.

    Returns (nb, nb, nb) arrays: number and level of the leaf that covers a brick, and whether the
    brick itself is divided further (where the leaf means nothing).
    """
    pyramid = [(vapour, droplets)]
    while pyramid[-1][0].shape[0] > 1:
        v, d = pyramid[-1]
        half = v.shape[0] // 2
        v = v.reshape(half, 2, half, 2, half, 2).mean(axis=(1, 3, 5))
        d = np.asarray(d.reshape(half, 2, half, 2, half, 2).any(axis=(1, 3, 5)))
        pyramid.append((v, d))
    number = np.zeros((1, 1, 1), np.int64)
    found = np.zeros((1, 1, 1), np.int32)
    open_ = np.ones((1, 1, 1), bool)
    following = 1
    for level, (v, d) in enumerate(reversed(pyramid)):
        edge_m = frame.edge_m / 2**level
        finest = level == frame.depth
        divide = open_ & (d | (v * edge_m > bound)) & (not finest)
        closed = open_ & ~divide
        leaves[level] += int(closed.sum())
        number[closed] = following + np.arange(int(closed.sum()))
        following += int(closed.sum())
        found[closed] = level
        if v.shape[0] == frame.bricks:
            return number, found, divide
        number = number.repeat(2, 0).repeat(2, 1).repeat(2, 2)
        found = found.repeat(2, 0).repeat(2, 1).repeat(2, 2)
        open_ = divide.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    raise AssertionError("the pyramid ends at the bricks")


def _merge_in_bricks(
    frame: Frame,
    vapour: Floats,
    droplets: NDArray[np.bool_],
    keep: NDArray[np.int32],
    bound: float,
    leaves: list[int],
) -> list[tuple[int, NDArray[np.bool_]]]:
    """Blocks of 4^3 and 2^3 cells in divided bricks that stay one leaf: (edge, where)."""
    edge = min(BRICK, frame.cells)
    level = frame.depth - edge.bit_length() + 1
    open_: NDArray[np.bool_] | None = None
    merged: list[tuple[int, NDArray[np.bool_]]] = []
    side = edge // 2
    while side >= 1:
        level += 1
        v = _blocks(vapour[keep], side).mean(axis=_IN_BLOCK, keepdims=True)
        d = _blocks(droplets[keep], side).any(axis=_IN_BLOCK, keepdims=True)
        if open_ is None:
            present = np.zeros(v.shape, bool)
            count = edge // side
            present[:, :count, :, :count, :, :count] = True
        else:
            present = open_.repeat(2, 1).repeat(2, 3).repeat(2, 5)
        divide = present & (d | (v * side * frame.cell_m > bound)) & (side > 1)
        closed = present & ~divide
        leaves[level] += int(closed.sum())
        if side > 1:
            merged.append((side, closed))
        open_ = divide
        side //= 2
    return merged
