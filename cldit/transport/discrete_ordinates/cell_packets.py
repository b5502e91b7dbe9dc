"""Cell packets for SIMD: the cells of a row along u in packets of 8, without empty packets.

Discrete ordinates sweeps (kernels/sweep.cl) traverse them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.fixed_point import fixed_point_defines
from cldit.transport.cells import OpticalCells, SweptBox

PACKET = 8  # cells, as in kernels/cell_packets.h


def simd_defines(device: Device) -> dict[str, int]:
    """Defines of the cells or path segments that a work-item processes at once (kernels/simd.h).

    Where it is one, sweeps add to sums in fixed point.
    """
    if device.is_cpu:
        return {"SIMD_WIDTH": PACKET}
    return {"SIMD_WIDTH": 1, **fixed_point_defines(device)}


@dataclass(frozen=True)
class CellPackets:
    """Packets, G of them, of a box [l][v][u] in one order of axes.

    first: (rows + 1,) first packet of each row, and the end.
    along: (G,) u of a packet's first cell; -1 - u if none of its cells scatters.
    number: (rows, places) number of the packet; -1 if all of its cells are empty.
    """

    first: NDArray[np.int32]
    along: NDArray[np.int32]
    number: NDArray[np.int32]

    @classmethod
    def of(cls, filled: NDArray[np.bool_], scatters: NDArray[np.bool_]) -> "CellPackets":
        """Packets of a box with masks (l, v, u) of the non-empty and of the scattering cells."""
        occupied = np.asarray(_split(filled).any(axis=2))
        row, place = np.nonzero(occupied)
        number = np.full(occupied.shape, -1, np.int32)
        number[row, place] = np.arange(len(row))
        clear = ~_split(scatters)[row, place].any(axis=1)
        return cls(
            first=np.searchsorted(row, np.arange(len(occupied) + 1)).astype(np.int32),
            along=np.where(clear, -1 - PACKET * place, PACKET * place).astype(np.int32),
            number=number,
        )

    @classmethod
    def both(cls, cells: OpticalCells, box: SweptBox) -> "dict[bool, CellPackets]":
        """Packets of `cells` in `box`: along x in rows [z][y]; turned: along y in rows [x][z]."""
        scatters = np.zeros(len(cells.depth), np.bool_)
        scatters[cells.address] = True
        filled = turned_too(cells.dense(box, cells.depth > 0))
        scattering = turned_too(cells.dense(box, scatters))
        return {turned: cls.of(filled[turned], scattering[turned]) for turned in filled}

    def __len__(self) -> int:
        return len(self.along)

    @property
    def cells(self) -> int:
        """Number of cells in packets, including empty ones."""
        return PACKET * len(self)

    def packed(self, dense: NDArray[Any]) -> NDArray[Any]:
        """Values (G, PACKET) of cells, from a dense array (l, v, u)."""
        return np.asarray(_split(dense)[self.number >= 0])

    def places(self, row: NDArray[np.int64], u: NDArray[np.int64]) -> NDArray[np.int32]:
        """Numbers (N,), through all packets, of cells at `u` (N,) in rows (N,); none is empty."""
        return np.asarray(self.number[row, u // PACKET] * PACKET + u % PACKET, np.int32)


def turned_too(dense: NDArray[Any]) -> dict[bool, NDArray[Any]]:
    """Array (z, y, x) as it is, and turned to (x, z, y)."""
    return {False: dense, True: dense.transpose(2, 0, 1)}


def _split(dense: NDArray[Any]) -> NDArray[Any]:
    """Array as (row, place, cell of the packet), padded with 0."""
    padded = np.pad(dense, ((0, 0), (0, 0), (0, -dense.shape[2] % PACKET)))
    return padded.reshape(dense.shape[0] * dense.shape[1], -1, PACKET)
