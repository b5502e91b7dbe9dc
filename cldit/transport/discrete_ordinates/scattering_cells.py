"""List of the scattering cells on the device, for the source update between sweeps.

kernels/source_update.cl moves values between the list and the swept box.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import download, unset, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.discrete_ordinates.cell_packets import PACKET, Real

Boxes = Mapping[bool, Any]  # buffers by order of packets: along x, and turned
Orders = tuple[bool, ...]
BOTH: Orders = (False, True)


@dataclass(frozen=True)
class ScatteringCells:
    """List of N scattering cells with C components.

    kernels: program of source_update.cl.
    source: device buffer of the source's planes, the first C of which are its isotropic part.
    """

    device: Device
    kernels: Program
    components: int
    count: int
    real: Real
    source: Any

    @classmethod
    def of(
        cls,
        device: Device,
        kernels: Program,
        *,
        components: int,
        planes: int,
        count: int,
        real: Real,
    ) -> "ScatteringCells":
        """List of N = `count` cells with a source of 0 in all `planes`."""
        source = zeros(device, "list", planes * count, real)
        return cls(device, kernels, components, count, real, source)

    def run(self, kernel: str, items: dict[str, int], *, high: int = 1, **arguments: Any) -> None:
        """Runs a kernel on so many items, given by the name of that argument, times `high`."""
        ((_, count),) = items.items()
        if count:
            # PoCL's default group size divides the number of cells, which may be a prime.
            group = min(256, self.kernels.largest_group(kernel))
            self.kernels.launch(kernel, (count, high), (group, 1), {**items, **arguments})

    def put(self, listed: Any, boxes: Boxes, places: Boxes, orders: Orders, **size: int) -> None:
        """Puts a list (planes, count) into the boxes of these orders of packets.

        `places` are the listed cells' places in either box; `size` has `planes` and `count`.
        """
        named = {"source": boxes[False], "source_turned": boxes[True], "listed": listed}
        self._move("set_source", named, places, orders, **size)

    def collect(self, out: Any, boxes: Boxes, places: Boxes, orders: Orders, **size: int) -> None:
        """Collects planes of the boxes of these orders into a list, with arguments as of `put`.

        The turned order alone adds to the list, which has the other order's.
        """
        named = {"out": out, "box": boxes[False], "box_turned": boxes[True]}
        self._move("collect_i_minus_s", named, places, orders, high=size["planes"], **size)

    def _move(
        self, kernel: str, buffers: dict[str, Any], places: Boxes, orders: Orders, *,
        planes: int, count: int, high: int = 1,
    ) -> None:  # fmt: skip
        bits = sum(1 << turned for turned in orders)
        at = {"place": places[False], "turned": places[True]}
        arguments = {**buffers, **at, "orders": bits, "planes": planes}
        self.run(kernel, {"count": count}, high=high, **arguments)

    @property
    def stride(self) -> int:
        """Numbers of a component in a vector: whole packets."""
        return -(-self.count // PACKET) * PACKET

    def unset(self, planes: int) -> Any:
        """Buffer of a list (planes, N)."""
        return unset(self.device, "list", planes * self.count, self.real)

    def read(self, listed: Any, planes: int | None = None) -> NDArray[Any]:
        """Downloads the first planes (P, N) of a list; None: all components of the first moment."""
        rows = self.components if planes is None else planes
        return download(self.device, listed, np.empty((rows, self.count), self.real))
