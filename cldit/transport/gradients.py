"""Where light diffuses through thick cells: how the source changes across each of them.

One source a cell, the same all over it, lets light through thick cells that scatter nearly all of
it too fast: between two such cells of optical depth t it carries 3 t / 4 times what diffusion does
(Larsen, Morel and Miller, J. Comput. Phys. 69, 1987, on the step method). With a source that is
linear in a cell, and goes over into its neighbours' as diffusion has it, sweeps keep that limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import Box, OpticalCells

_DEEP = 1.0  # optical depth of a cell from which on it matters
_LOSS = 0.3  # (edge / diffusion length)^2 up to which it does
_SOME = 0.3  # and the same for the cells in which the source is then linear
_LITTLE = 1.0


@dataclass(frozen=True)
class Gradients:
    """Change of the source across a cell along x, y, z, from its neighbours' sources.

    neighbours (6, N): of the scattering cells, which one lies below and above along x, y, z; itself
    where none counts. weights (6, N): of what the source is more there. The change along an axis is
    the difference of its two sums.
    """

    neighbours: NDArray[np.int32]
    weights: NDArray[np.float64]

    @classmethod
    def of(cls, cells: OpticalCells, box: Box) -> Gradients:
        """At the face to a neighbour the source lies between both by their optical depths: the flux
        of diffusion is then the same on both sides. Beyond a cell's last neighbour it goes on as it
        came."""
        depth = cells.depth[cells.address]
        chosen = (depth > _SOME) & (_loss(cells) < _LITTLE)
        x, y, z = (cells.positions(cells.address) - np.asarray(box.low)).T + 1
        number = np.full(np.array(box.shape[::-1]) + 2, -1, np.int32)
        number[z, y, x] = np.where(chosen, np.arange(len(depth)), -1)
        neighbours, weights = [], []
        for axis in range(3):
            step = np.eye(3, dtype=int)[axis]
            beside = [number[z + k * step[2], y + k * step[1], x + k * step[0]] for k in (-1, 1)]
            here = [chosen & (some >= 0) for some in beside]
            share = [
                np.where(there, depth / (depth + depth[some]), 0.0)
                for some, there in zip(beside, here, strict=True)
            ]
            for k in (0, 1):
                neighbours.append(np.where(here[k], beside[k], np.arange(len(depth))))
                weights.append(share[k] * np.where(here[1 - k], 1.0, 2.0))
        return cls(np.array(neighbours, np.int32), np.array(weights))


def matter(cells: OpticalCells) -> bool:
    """Whether light diffuses through some thick cell."""
    deep = cells.depth[cells.address] > _DEEP
    return bool(np.any(deep & (_loss(cells) < _LOSS)))


def _loss(cells: OpticalCells) -> NDArray[np.float64]:
    """Squared ratio (N,) of a cell's edge to the length on which diffusing light falls to 1 / e."""
    depth = cells.depth[cells.address]
    return np.asarray(3.0 * cells.coalbedo * depth * depth)
