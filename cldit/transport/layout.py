"""The three orders in which sweeps run through the cells of a box."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Layout:
    """One of the three orders of axes.

    stride_v, stride_l: of rows in the groups of cells (straight: [z][y]; turned: [x][z]).
    """

    number: int
    axes: tuple[int, int, int]  # u, v, l as x, y, z = 0, 1, 2
    size: tuple[int, int, int]
    stride_v: int
    stride_l: int
    turned: bool


def layouts(shape: tuple[int, int, int]) -> dict[int, Layout]:
    """Layout for each axis (x, y, z) that layers are stacked along."""
    nx, ny, nz = shape
    return {
        2: Layout(0, (0, 1, 2), (nx, ny, nz), 1, ny, turned=False),
        1: Layout(1, (0, 2, 1), (nx, nz, ny), ny, 1, turned=False),
        0: Layout(2, (1, 2, 0), (ny, nz, nx), 1, nz, turned=True),
    }
