"""Arrays of droplets through the kernels of kernels/spray/droplets.cl."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.errors import DeviceError
from cldit.gpu.buffers import download, unset, upload
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.spray.droplet.fluids import Fuel, Gas, property_table
from cldit.spray.droplet.models import Model


@dataclass(frozen=True)
class DropletKernels:
    """Droplets of a fuel in a carrier gas, with an evaporation model, on a device.

    width: droplets of a work-item. real: type of the device's numbers. table: buffer of the
    property table.
    """

    fuel: Fuel
    gas: Gas
    model: Model
    program: Program
    width: int
    real: type[np.floating]
    table: Any

    @classmethod
    def of(
        cls,
        device: Device,
        fuel: Fuel,
        gas: Gas,
        model: Model,
        *,
        real: type[np.floating] = np.float64,
    ) -> DropletKernels:
        """Builds the program; raises DeviceError if the device has no double precision."""
        double = real is np.float64
        if double and not device.info.float64:
            raise DeviceError(f"droplets need float64, which {device.info.name} does not have")
        width = 8 if device.is_cpu else 1
        defines: dict[str, Define] = {"EVAPORATION": model.function, "SIMD_WIDTH": width}
        defines |= {"USE_FLOAT64": 1} if double else {}
        program = build(device, "spray/droplets.cl", defines, preamble=model.source)
        table = property_table(fuel, gas).astype(real)
        return cls(fuel, gas, model, program, width, real, upload(device, "fuel", table))

    def run(
        self,
        kernel: str,
        columns: Mapping[str, Sequence[Floats]],
        results: int,
        **numbers: float,
    ) -> tuple[Floats, dict[str, Floats]]:
        """Runs a kernel on N droplets.

        Args:
            kernel: its name.
            columns: arguments that are arrays, each by its quantities (N,).
            results: number of quantities of the argument `out`.
            numbers: other arguments.

        Returns:
            `out` (results, N), and `droplets` (quantities, N), if given, as the kernel has left it.
        """
        device = self.program.device
        droplets = len(next(iter(columns.values()))[0])
        groups = -(-droplets // self.width)
        count = groups * self.width
        if count == 0:
            return np.empty((results, 0)), {n: np.empty((len(c), 0)) for n, c in columns.items()}
        # The last work-item is filled with copies of the last droplet.
        padded = {
            name: np.pad(np.stack(rows), ((0, 0), (0, count - droplets)), mode="edge")
            for name, rows in columns.items()
        }
        buffers = {
            name: upload(device, name, rows.astype(self.real)) for name, rows in padded.items()
        }
        buffers["out"] = unset(device, "out", results * count, self.real)
        self.program.launch(
            kernel,
            (groups,),
            (1,),  # one size, since a compiler may compile a kernel anew for another
            {"fuel": self.table, "count": count, **buffers, **numbers},
        )

        def back(name: str, quantities: int) -> Floats:
            array = np.empty((quantities, count), self.real)
            return download(device, buffers[name], array)[:, :droplets].astype(float)

        written = columns.keys() & {"droplets"}
        return back("out", results), {name: back(name, len(columns[name])) for name in written}
