"""The box of cells on the device, as sweeps along one order of its axes go through it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import PACKET, CellPackets, turned_too

Real = type[np.float32] | type[np.float64]


@dataclass(frozen=True)
class SweepArrays:
    """The box's groups of cells in one order, and the device's arrays of them.

    place: of the scattering cells among the cells of all groups. thermal: sources of what emits,
    [emitter][cell]. changed, across: place of those cells across which sources change among the
    cells of the groups that have any, and what the changes are, along x, y and z `linear_size`
    numbers each.
    """

    groups: CellPackets
    first: Any
    begins: Any
    place: Any
    depth: Any
    thermal: Any
    changed: Any
    across: Any
    linear_size: int

    @classmethod
    def of(
        cls,
        device: Device,
        cells: OpticalCells,
        box: Box,
        groups: CellPackets,
        real: Real,
        *,
        turned: bool,
        linear_cells: NDArray[np.intp],
    ) -> SweepArrays:
        """changing (M,): scattering cells across which sources change."""

        def packed(values: NDArray[np.float64]) -> NDArray[Any]:
            return groups.packed(turned_too(cells.dense(box, values.astype(real)))[turned])

        thermal = np.array([packed(cells.emitted[name]) for name in cells.needs.emitters], real)
        x, y, z = (cells.positions(cells.address) - np.asarray(box.low)).T
        _, ny, nz = box.shape
        place = groups.places(x * nz + z, y) if turned else groups.places(z * ny + y, x)
        group, lane = np.divmod(place[linear_cells], PACKET)
        some, within = np.unique(group, return_inverse=True)
        number = np.zeros(len(groups), np.int32)
        number[some] = np.arange(1, len(some) + 1)
        linear_size = len(some) * PACKET * len(cells.needs.components)
        return cls(
            groups=groups,
            first=upload(device, "groups of rows", groups.first),
            begins=upload(device, "groups", np.column_stack([groups.along, number])),
            place=upload(device, "places", place),
            depth=upload(device, "optical depth", packed(cells.depth)),
            thermal=upload(device, "thermal sources", thermal),
            changed=upload(device, "places", (within * PACKET + lane).astype(np.int32)),
            across=zeros(device, "changes across cells", 3 * linear_size, real),
            linear_size=linear_size,
        )
