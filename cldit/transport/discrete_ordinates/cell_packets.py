"""Cell packets for SIMD: the cells of a row along u in packets of 8, without empty packets.

Discrete ordinates sweeps (kernels/sweep.cl) traverse them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.fixed_point import fixed_point_defines
from cldit.transport.cells import OpticalCells, SweptBox, numbered

PACKET = 8  # cells, as in kernels/cell_packets.h

Real = type[np.float32] | type[np.float64]


def simd_defines(device: Device) -> dict[str, int]:
    """Defines of the cells or path segments that a work-item processes at once (kernels/simd.h).

    Where it is one, sweeps add to sums in fixed point.
    """
    if device.is_cpu:
        return {"SIMD_WIDTH": PACKET}
    return {"SIMD_WIDTH": 1, **fixed_point_defines(device)}


@dataclass(frozen=True)
class CellPackets:
    """Packets, G of them, of the swept box in one order of axes, and device arrays of their cells.

    turned: packets are along y, in rows [x][z]; else along x, in rows [z][y].
    number: (rows, places) number of the packet; -1 if all of its cells are empty.
    rows, begins: packets of rows, and their cells, see kernels/sweep.cl.
    place: places of the N scattering cells among the cells of all packets.
    depth: optical depth of the cells' edges.
    thermal: thermal sources, [emitter][cell].
    gradient_place: places of the linear cells among the cells of packets that have any.
    gradient: spatial gradient of the source in these; x, y and z are `linear_size` numbers each.
    """

    turned: bool
    number: NDArray[np.int32]
    rows: Any
    begins: Any
    place: Any
    depth: Any
    thermal: Any
    gradient_place: Any
    gradient: Any
    linear_size: int

    @classmethod
    def of(
        cls,
        device: Device,
        cells: OpticalCells,
        box: SweptBox,
        real: Real,
        *,
        turned: bool,
        linear_cells: NDArray[np.intp],
        by_ray: bool,
    ) -> "CellPackets":
        """Uploads a box with K `linear_cells` among the scattering ones.

        A sweep by ray looks up packets by their places, one by tile goes through those of a row.
        """
        occupied = np.asarray(_split(cells.dense(box, cells.depth > 0), turned=turned).any(axis=2))
        row, at = np.nonzero(occupied)
        number = numbered(np.flatnonzero(occupied), occupied.size).reshape(occupied.shape)

        def packed(values: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(_split(cells.dense(box, values), turned=turned)[number >= 0])

        scatters = np.zeros(len(cells.depth), np.bool_)
        scatters[cells.address] = True
        # u of a packet's first cell; -1 - u if none of its cells scatters.
        along = np.where(packed(scatters).any(axis=1), PACKET * at, -1 - PACKET * at)
        x, y, z = (cells.positions(cells.address) - np.asarray(box.low)).T
        _, ny, nz = box.shape
        row_of, u = (x * nz + z, y) if turned else (z * ny + y, x)
        place = np.asarray(number[row_of, u // PACKET] * PACKET + u % PACKET, np.int32)
        packet, lane = np.divmod(place[linear_cells], PACKET)
        listed_packets, within = np.unique(packet, return_inverse=True)
        linear = 1 + numbered(listed_packets, len(row))
        linear_size = len(listed_packets) * PACKET * len(cells.needs.components)
        first = np.searchsorted(row, np.arange(len(occupied) + 1)).astype(np.int32)
        begins = np.column_stack([along.astype(np.int32), linear])
        thermal = np.array(
            [packed(cells.emitted[name].astype(real)) for name in cells.needs.emitters], real
        )
        return cls(
            turned=turned,
            number=number,
            rows=upload(device, "packets of rows", number if by_ray else first),
            begins=upload(device, "packets", begins),
            place=upload(device, "places", place),
            depth=upload(device, "optical depth", packed(cells.depth.astype(real))),
            thermal=upload(device, "thermal sources", thermal),
            gradient_place=upload(device, "places", (within * PACKET + lane).astype(np.int32)),
            gradient=zeros(device, "spatial gradient", 3 * linear_size, real),
            linear_size=linear_size,
        )

    @cached_property
    def count(self) -> int:
        """Number G of packets."""
        return int(np.count_nonzero(self.number >= 0))

    @property
    def cells(self) -> int:
        """Number of cells in packets, including empty ones."""
        return PACKET * self.count

    def packed(self, dense: NDArray[Any]) -> NDArray[Any]:
        """Values (G, PACKET) of cells, from a dense array [z, y, x] of the box."""
        return np.asarray(_split(dense, turned=self.turned)[self.number >= 0])


def _split(dense: NDArray[Any], *, turned: bool) -> NDArray[Any]:
    """Array [z, y, x], or turned [x, z, y], as (row, place, cell of the packet), padded with 0."""
    rows = dense.transpose(2, 0, 1) if turned else dense
    padded = np.pad(rows, ((0, 0), (0, 0), (0, -rows.shape[2] % PACKET)))
    return padded.reshape(rows.shape[0] * rows.shape[1], -1, PACKET)
