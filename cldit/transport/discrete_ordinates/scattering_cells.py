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

    def run(self, kernel: str, *arguments: Any, count: int | None = None, planes: int = 1) -> None:
        """Runs a kernel over the cells, or so many items; and over planes."""
        items = self.count if count is None else count
        if items:
            # PoCL's own choice divides the number of cells, which may be a prime.
            group = min(_GROUP, self.device.info.largest_group)
            size = -(-items // group) * group, planes
            self.kernels[kernel](self.device.queue, size, (group, 1), *arguments, np.int32(items))

    def take(self, planes: NDArray[Any]) -> None:
        """Makes these (C, N) the source, or (C, M) of fewer cells, in its first numbers."""
        cl.enqueue_copy(self.device.queue, self.source, np.ascontiguousarray(planes, self.real))

    def put(self, planes: NDArray[Any], into: Any, place: Any) -> None:
        """Of the planes, C at a time, into the box; the first stay in the list."""
        for first in reversed(range(0, len(planes), self.components)):
            self.take(planes[first : first + self.components])
            numbers = np.int32(first), np.int32(len(planes))
            self.run("set_source", into, self.source, place, *numbers, count=planes.shape[1])

    def find(
        self, out: Any, box: Any, place: Any, *, turned: bool, planes: int, count: int | None = None
    ) -> None:
        """Lists so many planes of the box; what is in the turned groups comes on top."""
        numbers = np.int32(turned), np.int32(planes)
        self.run("collect_i_minus_s", out, box, place, *numbers, count=count, planes=planes)

    def read(self, listed: Any) -> NDArray[Any]:
        """The first C planes of a list."""
        return download(self.device, listed, np.empty((self.components, self.count), self.real))
