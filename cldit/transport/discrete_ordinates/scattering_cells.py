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
from cldit.transport.discrete_ordinates.cell_packets import PACKET
from cldit.transport.discrete_ordinates.sweep_arrays import Real

_GROUP = 256  # of the kernels with one work-item for each cell

Boxes = Mapping[bool, Any]  # buffers by order of packets: along x, and turned
Orders = tuple[bool, ...]
BOTH: Orders = (False, True)


def _bits(orders: Orders) -> int:
    """Orders as the kernels take them."""
    return sum(1 << turned for turned in orders)


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
            group = min(_GROUP, self.kernels.largest_group(kernel))
            self.kernels.launch(kernel, (count, high), (group, 1), {**items, **arguments})

    def put(
        self, listed: Any, boxes: Boxes, places: Boxes, orders: Orders, *, planes: int, count: int
    ) -> None:
        """Puts a list (planes, count) into the boxes of these orders of packets.

        `places` are the listed cells' places in either box.
        """
        self.run(
            "set_source",
            {"count": count},
            source=boxes[False],
            source_turned=boxes[True],
            listed=listed,
            place=places[False],
            turned=places[True],
            orders=_bits(orders),
            planes=planes,
        )

    def collect(
        self, out: Any, boxes: Boxes, places: Boxes, orders: Orders, *, planes: int, count: int
    ) -> None:
        """Collects planes of the boxes of these orders into a list (planes, count).

        The turned order alone adds to the list, which has the other order's.
        """
        self.run(
            "collect_i_minus_s",
            {"count": count},
            high=planes,
            out=out,
            box=boxes[False],
            box_turned=boxes[True],
            place=places[False],
            turned=places[True],
            orders=_bits(orders),
            planes=planes,
        )

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
