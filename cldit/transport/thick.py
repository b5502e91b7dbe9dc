"""Thick cells, within which the light varies, and the rim of other cells around them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.directions import Directions
from cldit.transport.layout import Layout, layouts

FACE = 64  # entries of the table of nearest directions along a side
NEITHER = -1


@dataclass(frozen=True)
class ThickCells:
    """Which cells of the swept box are thick.

    listed (T,): which of the scattering cells they are. low (3,), places [z, y, x] int32: the part
    of the box that holds them, from its lower corner, and what is there: number in the rim; -2 -
    number of a thick cell; -1 of neither. rim: cells that share a face with a thick one.
    """

    listed: NDArray[np.int64]
    low: NDArray[np.int64]
    places: NDArray[np.int32]
    rim: int

    @classmethod
    def of(cls, cells: OpticalCells, box: Box, *, deeper_than: float) -> ThickCells | None:
        """Scattering cells of an optical depth above `deeper_than`; None where there are none."""
        listed = np.flatnonzero(cells.depth[cells.address] > deeper_than)
        if not len(listed):
            return None
        at = cells.positions(cells.address[listed]) - np.asarray(box.low)
        low = np.maximum(at.min(axis=0) - 1, 0)
        high = np.minimum(at.max(axis=0) + 2, box.shape)
        places = np.full((high - low)[::-1], NEITHER, np.int32)
        x, y, z = (at - low).T
        places[z, y, x] = -2 - np.arange(len(listed))
        thick = places < NEITHER
        around = ndimage.binary_dilation(thick) & ~thick
        rim = int(np.count_nonzero(around))
        places[around] = np.arange(rim)
        return cls(listed, low, places, rim)

    def records(self, cells: OpticalCells, ends: Ends) -> NDArray[np.float64]:
        """(T, 2 + E + C): optical depth, albedo, emission, and the source of the sweeps; 3 C more
        where that changes across cells."""
        address = cells.address[self.listed]
        return np.column_stack(
            [
                cells.depth[address],
                cells.albedo[self.listed],
                cells.thermal_planes(np.float64, address).T,
                ends.source[:, self.listed].T,
                *(plane[:, self.listed].T for plane in ends.across),
            ]
        )


@dataclass(frozen=True)
class Ends:
    """What chains of scatterings within thick cells end in.

    directions, light: of the last sweeps. source (C, N): of the cells, as it was solved for;
    across: how it changes across them along x, y, z, (C, N) each, where that was of account.
    """

    directions: Directions
    light: RimLight
    source: NDArray[np.floating]
    across: tuple[NDArray[np.float64], ...] = ()


@dataclass(frozen=True)
class RimLight:
    """Light that leaves the cells of the rim, as sweeps store it: [direction][cell][component].

    rows, cells: where a row of each layout finds them. first: number of the sweeps' first
    direction.
    """

    buffer: Any
    rim: int
    rows: dict[int, Any]
    cells: dict[int, Any]
    first: int = 0

    def after(self, directions: int) -> RimLight:
        """For sweeps that follow so many directions."""
        return replace(self, first=directions)

    @classmethod
    def of(
        cls,
        device: Device,
        thick: ThickCells,
        box: Box,
        *,
        components: int,
        directions: int,
        real: type[np.floating],
    ) -> RimLight:
        z, y, x = np.nonzero(thick.places >= 0)
        number = thick.places[z, y, x]
        at = (x + thick.low[0], y + thick.low[1], z + thick.low[2])
        rows, listed = {}, {}
        for layout in layouts(box.shape).values():
            along, across, up = (at[axis] for axis in layout.axes)
            _, nv, nl = layout.size
            row = up * nv + across
            order = np.argsort(row, kind="stable")
            starts = np.searchsorted(row[order], np.arange(nl * nv + 1))
            rows[layout.number] = upload(device, "rows of the rim", starts.astype(np.int32))
            listed[layout.number] = upload(
                device, "rim", np.stack([along[order], number[order]], axis=1).astype(np.int32)
            )
        size = directions * thick.rim * components
        return cls(zeros(device, "light of the rim", size, real), thick.rim, rows, listed)

    def arguments(self, layout: Layout) -> list[Any]:
        """Kernel arguments `light` to `rim_cells`."""
        return [
            self.buffer,
            np.int32(self.first),
            np.int32(self.rim),
            self.rows[layout.number],
            self.cells[layout.number],
        ]


def nearest(directions: Directions) -> NDArray[np.int32]:
    """(FACE, FACE) number of the nearest direction for each entry of kernels/gather.cl's table."""
    middle = (np.arange(FACE) + 0.5) * 2 / FACE - 1
    v, u = np.meshgrid(middle, middle, indexing="ij")
    z = 1 - np.abs(u) - np.abs(v)
    below = z < 0
    x = np.where(below, (1 - np.abs(v)) * np.copysign(1.0, u), u)
    y = np.where(below, (1 - np.abs(u)) * np.copysign(1.0, v), v)
    points = np.stack([x, y, z], axis=2).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return np.asarray(np.argmax(points @ directions.unit.T, axis=1), np.int32)
