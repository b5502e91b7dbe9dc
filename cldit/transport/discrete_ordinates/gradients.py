"""How the source, and the light, change across each scattering cell, from those beside it.

In the picture light does: a cell is many pixels wide (`spatial_gradients`). In the sweeps the
source
does where light diffuses through thick cells (`Gradients`). One source a cell, the same all over
it, lets light through thick cells that scatter nearly all of it too fast: between two such cells of
optical depth t it carries 3 t / 4 times what diffusion does (Larsen, Morel and Miller, J. Comput.
Phys. 69, 1987, on the step method). With a source that is linear in a cell, and goes over into its
neighbours' as diffusion has it, sweeps keep that limit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import Box, OpticalCells
from cldit.transport.tuning import Tuning

Floats = NDArray[np.float64]
Numbers = NDArray[np.int32]


@dataclass(frozen=True)
class Gradients:
    """Change of the source across a cell along x, y, z, from two neighbours' sources each.

    neighbours (6, N): of the scattering cells, two an axis; the cell itself where none counts.
    weights (6, N): of what the source is more there than here.
    """

    neighbours: NDArray[np.int32]
    weights: Floats

    @classmethod
    def of(cls, cells: OpticalCells, box: Box, tuning: Tuning) -> Gradients:
        depth = cells.depth[cells.address]
        lengths = np.sqrt(3.0 * cells.coalbedo) * depth
        chosen = (lengths < tuning.linear_lengths) & (depth < tuning.diffusion_most)
        axes = [
            _along(depth, *beside, alike=tuning.alike)
            for beside in _beside(cells, box, (-2, -1, 1, 2), chosen)
        ]
        return cls(
            neighbours=np.concatenate([neighbours for neighbours, _ in axes]),
            weights=np.concatenate([weights for _, weights in axes]),
        )

    def __call__(self, source: NDArray[np.floating]) -> Floats:
        """(3, C, N) change across each cell of a source (C, N)."""
        more = [
            weight * (source[:, neighbour] - source)
            for weight, neighbour in zip(self.weights, self.neighbours, strict=True)
        ]
        return np.stack([more[0] + more[1], more[2] + more[3], more[4] + more[5]])


def diffusion_matters(cells: OpticalCells, *, scattered: float, tuning: Tuning) -> bool:
    """Whether light diffuses through thick cells, if this share of the scattering counts.

    It does in cells of some depth, in which little of what is met is absorbed, and which are few
    diffusion lengths deep. In the deepest diffusion is so slow beside what neighbours exchange
    where their sources do not meet that the solver would not come to an end.
    """
    counts = cells.coalbedo + scattered * cells.albedo
    depth, coalbedo = counts * cells.depth[cells.address], cells.coalbedo / counts
    diffuses = (depth > tuning.diffusion_least) & (depth < tuning.diffusion_most)
    diffuses &= coalbedo < tuning.diffusion_coalbedo
    diffuses &= np.sqrt(3.0 * coalbedo) * depth < tuning.diffusion_lengths
    return bool(diffuses.any())


def spatial_gradients(
    light: NDArray[np.floating],
    cells: OpticalCells,
    box: Box,
    known: tuple[NDArray[np.intp], NDArray[np.floating]] | None = None,
) -> NDArray[np.floating]:
    """(3, C, N) change of the light (C, N) in the scattering cells across each of them along x, y,
    z, from what it is at the faces to those beside it: between both means, nearer to that of the
    thinner one, in which light changes less. Where there is but one beside it, it changes as much
    on the other side. known: cells (M,) and the change (3, C, M) that was found across them.
    Nowhere so much that all of it would be less than nothing.

    The share of a cell in the difference goes by the root of its optical depth: by the depth
    itself, where light diffuses; by none, where cells are alike in all but where they lie. On `gdi`
    the root errs least.
    """
    every = np.arange(len(cells.address))
    changes = np.zeros((3, *light.shape), light.dtype)
    root = np.sqrt(cells.depth[cells.address]).astype(light.dtype)
    beside = _beside(cells, box, (-1, 1), np.ones(len(every), bool))
    for change, (below, above) in zip(changes, beside, strict=True):
        sides = np.where((below >= 0) & (above >= 0), 1, 2).astype(light.dtype)
        for there, sign in ((below, -1), (above, 1)):
            near = np.where(there >= 0, there, every)
            share = sign * sides * root / (root + root[near])
            change += share * (np.take(light, near, axis=1) - light)
    if known is not None:
        changes[:, :, known[0]] = known[1]
    limit(changes, light)
    return changes


def limit(changes: NDArray[np.floating], light: NDArray[np.floating]) -> None:
    """Makes changes (3, C, N) across cells of a mean (C, N) no larger than leaves nowhere less than
    nothing of the sum of its components."""
    total, most = light.sum(axis=0), np.abs(changes.sum(axis=1)).sum(axis=0)
    changes *= np.divide(2 * total, most, out=np.ones_like(total), where=most > 2 * total)


def _beside(
    cells: OpticalCells, box: Box, steps: Sequence[int], chosen: NDArray[np.bool_]
) -> Iterator[list[Numbers]]:
    """For x, y and z, which of the chosen scattering cells (N,) lies so many steps from each of
    them; -1: none."""
    far = max(steps)
    at = (cells.positions(cells.address) - np.asarray(box.low)).T + far
    number = np.full(np.array(box.shape[::-1]) + 2 * far, -1, np.int32)
    number[tuple(at[::-1])] = np.where(chosen, np.arange(len(chosen)), -1)
    for axis in range(3):
        segments = [at + step * np.eye(3, dtype=int)[:, axis, None] for step in steps]
        yield [np.where(chosen, number[tuple(way[::-1])], -1) for way in segments]


def _along(
    depth: Floats,
    below_2: Numbers,
    below: Numbers,
    above: Numbers,
    above_2: Numbers,
    *,
    alike: float,
) -> tuple[Numbers, Floats]:
    """Two neighbours (2, N) of each cell on an axis, and their weights; -1: there is none.

    At a face the source lies between both cells' by their depths: the flux of diffusion is then the
    same on both sides. A cell with but one neighbour has its change by depth extrapolated from the
    face to that and, if there is one beyond and both are alike, from that neighbour's own.
    """
    both = (below >= 0) & (above >= 0)
    neighbours = np.stack([below, above])
    weights = np.stack([-depth / (depth + depth[below]), depth / (depth + depth[above])]) * both
    for row, near, far, other in ((0, below, below_2, above), (1, above, above_2, below)):
        sign = 2 * row - 1
        alone = (near >= 0) & (other < 0)
        further = alone & (far >= 0) & (depth < alike * np.minimum(depth[near], depth[far]))
        face, next_face = depth + depth[near], depth[near] + depth[far]
        extrapolated = np.where(further, 3 * depth / face + depth / next_face, 2 * depth / face)
        weights[row] = np.where(alone, sign * extrapolated, weights[row])
        weights[1 - row] = np.where(further, -sign * depth / next_face, weights[1 - row])
        neighbours[1 - row] = np.where(further, far, neighbours[1 - row])
    every = np.arange(len(depth), dtype=np.int32)
    return np.where(neighbours >= 0, neighbours, every), weights
