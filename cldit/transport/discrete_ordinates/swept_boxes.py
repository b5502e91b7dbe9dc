"""Boxes of the swept cells on the device, in both orders of packets (stages 1 to 3)."""

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import clear, unset
from cldit.gpu.device import Device
from cldit.transport.cells import OpticalCells, SweptBox
from cldit.transport.discrete_ordinates.cell_packets import CellPackets, Real
from cldit.transport.discrete_ordinates.scattering_cells import (
    BOTH,
    Boxes,
    Orders,
    ScatteringCells,
)


class SweptBoxes:
    """Cells of the swept box in packets along x, and again along y (turned), with their source.

    Rays along x traverse rows of memory as those along y and z do.

    packets: of either order.
    apart: either order has a box of its own; else they share one, as memory is short.
    source: box of the source, with all of its planes.
    real, sum_type: types of a source, and of the sums of a sweep.
    """

    def __init__(
        self,
        device: Device,
        cells: OpticalCells,
        box: SweptBox,
        *,
        planes: int,
        real: Real,
        sum_type: type[np.generic],
        linear_cells: NDArray[np.intp],
        by_ray: bool,
    ) -> None:
        """Uploads `cells`, with room for `planes` of the source.

        Other arguments are those of `CellPackets.of`.
        """
        self.device, self.box, self.real, self.sum_type = device, box, real, sum_type
        self._planes = planes
        self.packets = {
            turned: CellPackets.of(
                device, cells, box, real, turned=turned, linear_cells=linear_cells, by_ray=by_ray
            )
            for turned in BOTH
        }
        self.places = {turned: packets.place for turned, packets in self.packets.items()}
        self.linear_places = {turned: p.gradient_place for turned, p in self.packets.items()}
        number_bytes = np.dtype(real).itemsize + np.dtype(sum_type).itemsize
        packed_bytes = sum(packets.cells for packets in self.packets.values()) * number_bytes
        # Up to a 32nd of the memory either order has a box of its own, for source and for sums.
        self.apart = packed_bytes * planes < device.info.memory_bytes / 32
        self.source = self.unset("source", planes, real)
        self._emission: tuple[bool, bool] | None = None

    def unset(self, label: str, planes: int, dtype: type[np.generic]) -> Boxes:
        """Buffer of either order's box; the orders share one if memory is short."""
        sizes = {turned: planes * packets.cells for turned, packets in self.packets.items()}
        if self.apart:
            return {turned: unset(self.device, label, sizes[turned], dtype) for turned in BOTH}
        return dict.fromkeys(BOTH, unset(self.device, label, max(sizes.values()), dtype))

    def fill(
        self, listed: ScatteringCells, orders: Orders, *, emits: bool, shining: bool, cavity: bool
    ) -> None:
        """Puts the source of the `listed` cells into the boxes of these orders.

        With `shining` all other cells have their thermal source, if the medium `emits`; with
        `cavity` they emit 1. A box of its own keeps that emission from sweep to sweep.
        """
        if not self.apart or self._emission != (shining, cavity):
            for packets in (self.packets[turned] for turned in orders):
                box = self.source[packets.turned]
                clear(self.device, box, self._planes * packets.cells, self.real)
                if emits and shining:
                    listed.run(
                        "emit",
                        {"packets": packets.count},
                        source=box,
                        thermal=packets.thermal,
                        cavity=int(cavity),
                        planes=self._planes,
                    )
            self._emission = (shining, cavity)
        sizes = {"planes": self._planes, "count": listed.count}
        listed.put(listed.source, self.source, self.places, orders, **sizes)
