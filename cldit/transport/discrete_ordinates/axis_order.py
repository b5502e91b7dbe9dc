"""Orders of the axes in which discrete ordinates sweeps traverse the box."""

from dataclasses import dataclass

from cldit.transport.discrete_ordinates.cell_packets import PACKET


@dataclass(frozen=True)
class AxisOrder:
    """One of the three orders of axes: u, v (within a layer) and l (across layers).

    axes: u, v, l as x, y, z = 0, 1, 2.
    size: cells along u, v, l.
    stride_v, stride_l: strides of rows in the cell packets (straight: [z][y]; turned: [x][z]).
    turned: true if packets are along y.
    """

    number: int
    axes: tuple[int, int, int]
    size: tuple[int, int, int]
    stride_v: int
    stride_l: int
    turned: bool

    @property
    def slots(self) -> int:
        """Slots of a row of rays: those in the box, in whole packets, and those entering it."""
        nu, _, nl = self.size
        return -(-nu // PACKET) * PACKET + nl + 4

    @property
    def ray_rows(self) -> int:
        """Rows of rays: those in the box, and those entering it."""
        return self.size[1] + self.size[2] + 2


def axis_orders(shape: tuple[int, int, int]) -> dict[int, AxisOrder]:
    """Order of axes in a box for each stacking direction of layers, x, y, z = 0, 1, 2."""
    nx, ny, nz = shape
    return {
        2: AxisOrder(0, (0, 1, 2), (nx, ny, nz), 1, ny, turned=False),
        1: AxisOrder(1, (0, 2, 1), (nx, nz, ny), ny, 1, turned=False),
        0: AxisOrder(2, (1, 2, 0), (ny, nz, nx), 1, nz, turned=True),
    }
