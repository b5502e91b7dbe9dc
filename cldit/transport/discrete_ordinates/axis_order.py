"""The three orders in which sweeps run through the cells of a box."""

from __future__ import annotations

from dataclasses import dataclass

from cldit.transport.discrete_ordinates.cell_packets import PACKET


@dataclass(frozen=True)
class AxisOrder:
    """One of the three orders of axes.

    stride_v, stride_l: of rows in the groups of cells (straight: [z][y]; turned: [x][z]).
    """

    number: int
    axes: tuple[int, int, int]  # u, v, l as x, y, z = 0, 1, 2
    size: tuple[int, int, int]
    stride_v: int
    stride_l: int
    turned: bool

    @property
    def slots(self) -> int:
        """For a row of rays: those that are in the box, in whole groups, and those that come in."""
        nu, _, nl = self.size
        return -(-nu // PACKET) * PACKET + nl + 4

    @property
    def ray_rows(self) -> int:
        """Of rays: those that are in the box, and those that come in."""
        return self.size[1] + self.size[2] + 2


def axis_orders(shape: tuple[int, int, int]) -> dict[int, AxisOrder]:
    """Layout for each axis (x, y, z) that layers are stacked along."""
    nx, ny, nz = shape
    return {
        2: AxisOrder(0, (0, 1, 2), (nx, ny, nz), 1, ny, turned=False),
        1: AxisOrder(1, (0, 2, 1), (nx, nz, ny), ny, 1, turned=False),
        0: AxisOrder(2, (1, 2, 0), (ny, nz, nx), 1, nz, turned=True),
    }
