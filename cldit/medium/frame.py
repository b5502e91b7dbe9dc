"""Cube of the domain, its finest cells, and the bricks of 8 x 8 x 8 cells that store them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

BRICK = 8  # cells along a brick's edge; the kernels use the same number
CELLS_PER_BRICK = BRICK**3
# Boxes, layers of clouds or pairs of box and cell in memory together, of 30 to 60 bytes each.
AT_ONCE = 4_000_000
TOLERANCE = 1e-5  # in cells: largest distance of a box from its place on a lattice


@dataclass(frozen=True)
class Cube:
    """Cube of `cells`**3 finest cells.

    lower_m: lower corner of the cube; depth: number of halvings; cells = 2**depth.
    """

    lower_m: tuple[float, float, float]
    edge_m: float
    depth: int

    @classmethod
    def around(
        cls, *, centre_m: tuple[float, float, float], edge_m: float, leaf_edge_m: float
    ) -> "Cube":
        """Cube, halved until an edge is below `leaf_edge_m` (paper, Section "Ray Tracing")."""
        x, y, z = (middle - edge_m / 2 for middle in centre_m)
        frame = cls(lower_m=(x, y, z), edge_m=edge_m, depth=0)
        while frame.cell_m >= leaf_edge_m:
            frame = frame.at(frame.depth + 1)
        return frame

    def at(self, depth: int) -> "Cube":
        """Same cube, halved `depth` times."""
        return replace(self, depth=depth)

    @property
    def cells(self) -> int:
        """Finest cells along an edge."""
        return int(2**self.depth)

    @property
    def cell_m(self) -> float:
        """Edge of a finest cell."""
        return self.edge_m / self.cells

    @property
    def bricks(self) -> int:
        """Bricks along an edge; a cube of fewer than eight cells has one brick, partly used."""
        return max(1, self.cells // BRICK)

    def to_cells(self, position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (N, 3) in units of cells from the lower corner."""
        cells = position_m - np.asarray(self.lower_m)
        cells /= self.cell_m
        return np.asarray(cells)
