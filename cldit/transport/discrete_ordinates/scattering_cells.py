"""The scattering cells as a list on the device, beside the box in which they are swept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.gpu.buffers import download, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.discrete_ordinates.sweep_arrays import Real

_GROUP = 256  # of the kernels that go from cell to cell


@dataclass(frozen=True)
class ScatteringCells:
    """N cells of C components each, and what goes from them into the box and back
    (source_update.cl).

    source: (C, N) of theirs, on the device; more planes go through it C at a time.
    """

    device: Device
    kernels: Program
    components: int
    count: int
    real: Real
    source: Any

    @classmethod
    def of(
        cls, device: Device, kernels: Program, *, components: int, count: int, real: Real
    ) -> ScatteringCells:
        """With a source of 0."""
        source = zeros(device, "list", components * count, real)
        return cls(device, kernels, components, count, real, source)

    def run(self, kernel: str, items: dict[str, int], *, high: int = 1, **arguments: Any) -> None:
        """Runs a kernel over items, whose number is an argument of this name, times `high`."""
        ((_, count),) = items.items()
        if count:
            # PoCL's own choice divides the number of cells, which may be a prime.
            group = min(_GROUP, self.kernels.largest_group(kernel))
            self.kernels.launch(kernel, (count, high), (group, 1), {**items, **arguments})

    def take(self, planes: NDArray[Any]) -> None:
        """Makes these (C, N) the source, or (C, M) of fewer cells, in its first numbers."""
        cl.enqueue_copy(self.device.queue, self.source, np.ascontiguousarray(planes, self.real))

    def put(self, planes: NDArray[Any], into: Any, place: Any) -> None:
        """Of the planes, C at a time, into the box; the first stay in the list."""
        for first in reversed(range(0, len(planes), self.components)):
            self.take(planes[first : first + self.components])
            self.run(
                "set_source",
                {"count": planes.shape[1]},
                source=into,
                listed=self.source,
                place=place,
                first=first,
                planes=len(planes),
            )

    def find(
        self, out: Any, box: Any, place: Any, *, turned: bool, planes: int, count: int | None = None
    ) -> None:
        """Lists so many planes of the box; what is in the turned groups comes on top."""
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

    def read(self, listed: Any) -> NDArray[Any]:
        """The first C planes of a list."""
        return download(self.device, listed, np.empty((self.components, self.count), self.real))
