"""Spatial gradients of the source in each scattering cell, from its neighbours.

The solver's sweeps use them where light diffuses through thick cells (stage 1): with a constant
source the flux between two cells of optical depth t and albedo near 1 is
3 t / 4 times that of diffusion (Larsen, Morel and Miller, J. Comput. Phys. 69, 1987, on the step
method). A linear source that is continuous at faces has the diffusion limit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask, Reals
from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.transport.cells import OpticalCells, SweptBox
from cldit.transport.tuning import Tuning

Numbers = NDArray[np.int32]


@dataclass(frozen=True)
class Gradients:
    """Finite differences for the source's gradient along x, y, z, per cell.

    neighbours: (6, N) two scattering cells for each axis; the cell itself if there is none.
    weights: (6, N) weights of the neighbours' differences from the cell.
    """

    neighbours: NDArray[np.int32]
    weights: Floats

    @classmethod
    def of(cls, cells: OpticalCells, box: SweptBox, tuning: Tuning) -> "Gradients":
        """Finite differences of the scattering cells in which light diffuses."""
        depth = cells.depth[cells.address]
        lengths = np.sqrt(3.0 * cells.coalbedo) * depth
        chosen = (lengths < tuning.linear_lengths) & (depth < tuning.diffusion_most)
        axes = [
            _along(depth, *beside, alike=tuning.alike)
            for beside in beside_on_axes(cells, box, (-2, -1, 1, 2), chosen)
        ]
        return cls(
            neighbours=np.concatenate([neighbours for neighbours, _ in axes]),
            weights=np.concatenate([weights for _, weights in axes]),
        )

    def upload(self, device: Device, real: type[np.floating]) -> dict[str, Any]:
        """Kernel arguments of both."""
        return {
            "neighbours": upload(device, "neighbours", self.neighbours),
            "weights": upload(device, "neighbours' weights", self.weights.astype(real)),
        }

    def __call__(self, source: Reals) -> Floats:
        """Gradient (3, C, N) of a source (C, N), per cell."""
        slopes = [
            weight * (source[:, neighbour] - source)
            for weight, neighbour in zip(self.weights, self.neighbours, strict=True)
        ]
        return np.stack([slopes[0] + slopes[1], slopes[2] + slopes[3], slopes[4] + slopes[5]])


def diffusion_matters(cells: OpticalCells, *, scattered: float | Floats, tuning: Tuning) -> bool:
    """True if light diffuses through any cells.

    These are thick cells of low coalbedo that are few diffusion lengths across. The thickest do not
    count: the solver would not converge where linear sources are discontinuous. `scattered` is the
    share of the scattering that counts, of all cells or (N,).
    """
    counts = cells.coalbedo + scattered * cells.albedo
    depth, coalbedo = counts * cells.depth[cells.address], cells.coalbedo / counts
    diffuses = (depth > tuning.diffusion_least) & (depth < tuning.diffusion_most)
    diffuses &= coalbedo < tuning.diffusion_coalbedo
    diffuses &= np.sqrt(3.0 * coalbedo) * depth < tuning.diffusion_lengths
    return bool(diffuses.any())


def beside_on_axes(
    cells: OpticalCells, box: SweptBox, offsets: Sequence[int], chosen: Mask
) -> Iterator[list[Numbers]]:
    """Yields for x, y and z the numbers (N,) of the chosen cells at these offsets; -1: none."""
    reach = max(offsets)
    at = (cells.positions(cells.address) - np.asarray(box.low)).T + reach
    number = np.full(np.array(box.shape[::-1]) + 2 * reach, -1, np.int32)
    number[tuple(at[::-1])] = np.where(chosen, np.arange(len(chosen)), -1)
    for axis in range(3):
        shifted = [at + offset * np.eye(3, dtype=int)[:, axis, None] for offset in offsets]
        yield [np.where(chosen, number[tuple(place[::-1])], -1) for place in shifted]


def _along(
    depth: Floats,
    below_2: Numbers,
    below: Numbers,
    above: Numbers,
    above_2: Numbers,
    *,
    alike: float,
) -> tuple[Numbers, Floats]:
    """Two neighbours (2, N) of each cell on an axis, and their weights (2, N).

    At a face the source is interpolated by the depths of both cells, so that the diffusion flux is
    the same on both sides. A cell with one neighbour has its slope in depth extrapolated from that
    face and, if there is a cell beyond and both have similar depths, from the neighbour's slope.

    below_2, below, above, above_2: (N,) numbers of the cells at -2, -1, 1 and 2; -1: none. alike:
    largest ratio of similar depths.
    """
    two_sided = (below >= 0) & (above >= 0)
    neighbours = np.stack([below, above])
    weights = (
        np.stack([-depth / (depth + depth[below]), depth / (depth + depth[above])]) * two_sided
    )
    for row, neighbour, second_neighbour, opposite in (
        (0, below, below_2, above),
        (1, above, above_2, below),
    ):
        sign = 2 * row - 1
        one_sided = (neighbour >= 0) & (opposite < 0)
        further = (
            one_sided
            & (second_neighbour >= 0)
            & (depth < alike * np.minimum(depth[neighbour], depth[second_neighbour]))
        )
        face, next_face = depth + depth[neighbour], depth[neighbour] + depth[second_neighbour]
        extrapolated = np.where(further, 3 * depth / face + depth / next_face, 2 * depth / face)
        weights[row] = np.where(one_sided, sign * extrapolated, weights[row])
        weights[1 - row] = np.where(further, -sign * depth / next_face, weights[1 - row])
        neighbours[1 - row] = np.where(further, second_neighbour, neighbours[1 - row])
    number = np.arange(len(depth), dtype=np.int32)
    return np.where(neighbours >= 0, neighbours, number), weights
