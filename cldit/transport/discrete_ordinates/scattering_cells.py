"""List of the scattering cells on the device, for the source update between sweeps.

kernels/source_update.cl moves values between the list and the swept box.
"""

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

    def put(self, into: Any, place: Any, *, planes: int) -> None:
        """Puts the source into a box; `into` is its buffer, `place` that of the cells' places."""
        self.put_list(self.source, into, place, planes=planes, count=self.count)

    def put_list(self, listed: Any, into: Any, place: Any, *, planes: int, count: int) -> None:
        """Puts a list (planes, count) into a box as `put`."""
        arguments = {"source": into, "listed": listed, "place": place, "planes": planes}
        self.run("set_source", {"count": count}, **arguments)

    def collect(
        self, out: Any, box: Any, place: Any, *, turned: bool, planes: int, count: int | None = None
    ) -> None:
        """Collects planes of a box into a list.

        Args:
            out: buffer of the list (planes, count).
            box, place: buffers of the box, and of the cells' places in it.
            turned: adds to the list, after the other order of packets.
        """
        self.run(
            "collect_i_minus_s",
            {"count": self.count if count is None else count},
            high=planes,
            out=out,
            box=box,
            place=place,
            more=int(turned),
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
