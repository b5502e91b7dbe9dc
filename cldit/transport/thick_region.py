"""Thick cells, and the region of these and of those beside them, through which flights go.

What stands beside a thick cell, or beyond a gap between two, casts shadows that are smaller than a
cell. So flights go on through the cells around thick ones, and end at the faces of this region.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cldit.transport.cells import Box, OpticalCells
from cldit.transport.tuning import Tuning

NONE, OUTSIDE = -1, -2
_KEPT = -2  # less the number of a face, as in path_segment.h
_HEAD = 4  # numbers of a record before its planes, which are in fours, as in cell_record.h


@dataclass(frozen=True)
class ThickRegion:
    """Which cells of the swept box are thick, and the region of these and of those around them.

    listed (T,): which of the scattering cells are thick. at (R, 3), address (R,): of the region's
    cells, in the box and among stored cells; -1: not stored. low (3,), places [z, y, x] int32: the
    part of the box around the region, and number of its cell there; -1 of none. beside (R, 8)
    int32: what lies beside each cell, as kernels/path_segment.h has it. rim: so many numbers of
    light.
    """

    listed: NDArray[np.int64]
    at: NDArray[np.int64]
    address: NDArray[np.int64]
    low: NDArray[np.int64]
    places: NDArray[np.int32]
    beside: NDArray[np.int32]
    interfaces: int

    @classmethod
    def of(
        cls,
        cells: OpticalCells,
        box: Box,
        *,
        deeper_than: float,
        tuning: Tuning,
        light_bytes: int = 0,
    ) -> ThickRegion | None:
        """Scattering cells of an optical depth above `deeper_than`; None where there are none.

        light_bytes: that the light in one cell takes, along all directions of the last sweeps.
        Where it takes too much in all none has a number, and flights find all that is scattered.
        """
        listed = np.flatnonzero(cells.depth[cells.address] > deeper_than)
        if not len(listed):
            return None
        there = cells.positions(cells.address[listed]) - np.asarray(box.low)
        low = np.maximum(there.min(axis=0) - tuning.margin - 1, 0)
        high = np.minimum(there.max(axis=0) + tuning.margin + 2, box.shape)
        thick = np.zeros((high - low)[::-1], bool)
        thick[tuple((there - low).T[::-1])] = True
        region = ndimage.binary_dilation(thick, iterations=tuning.margin)
        places = np.full(region.shape, NONE, np.int32)
        places[region] = np.arange(np.count_nonzero(region))
        at = np.argwhere(region)[:, ::-1]
        around = np.pad(places, 1, constant_values=OUTSIDE)
        beside = np.full((len(at), 8), NONE, np.int32)
        interfaces = 0
        for axis in range(3):
            ends = []
            for up in (0, 1):
                near = at.T + 1
                near[axis] += 2 * up - 1
                number = around[tuple(near[::-1])]
                ends_there = number == NONE
                ends.append(interfaces + int(np.count_nonzero(ends_there)))
                number = np.where(number == OUTSIDE, NONE, number)
                number[ends_there] = _KEPT - np.arange(interfaces, ends[-1])
                beside[:, 2 * axis + up] = number
            interfaces = max(ends)
        if light_bytes * len(listed) <= tuning.stored_bytes:
            owner = places[tuple((there - low).T[::-1])]
            beside[owner, 6] = interfaces + np.arange(len(listed))
            interfaces += len(listed)
        at += low
        address = cells.stored(at + np.asarray(box.low))
        return cls(listed, at, address, low, places, beside, interfaces)

    @property
    def faces(self) -> NDArray[np.int32]:
        """(R, 6) number of each cell's faces to cells of the box that are not of the region; -1 of
        others. Of two that no one direction goes through both may have one number, as flights end
        in light of a direction in their own octant."""
        sides = self.beside[:, :6]
        return np.where(sides <= _KEPT, _KEPT - sides, NONE)

    @property
    def own(self) -> NDArray[np.int32]:
        """(R,) number for the light in a thick cell itself, after those of faces; -1 in others."""
        return self.beside[:, 6]

    def records(
        self,
        seen: OpticalCells,
        cells: OpticalCells,
        source: NDArray[np.floating],
        changes: NDArray[np.floating] | None,
        linear_cells: NDArray[np.intp],
        *,
        deep: float | None,
        tuning: Tuning,
    ) -> NDArray[np.floating]:
        """Records as in kernels/cell_record.h, one a row: optical depth; albedo and emission of
        deep cells, in which chains go on; the last sweep's source, and its changes; of deep cells
        these of what they scatter, over their albedo.

        seen, cells: the medium as it is, and as that sweep has it; source (M C, N): of its
        scattering cells; changes (3, C, K): across those of them that `linear_cells` (K,) lists, or
        None. deep: optical depth of a cell beyond which a source that is linear in it is not
        enough; None: no cell is deep, for each flight of a chain is an order more. What is not
        stored is empty.
        """
        stored = self.address >= 0
        address = self.address[stored]
        number = np.full(len(cells.depth), NONE)
        number[cells.address] = np.arange(len(cells.address))
        number = number[address]
        scatters = number >= 0
        depth, albedo = seen.depth[address], seen.albedo[number]
        if deep is None:
            chains = np.zeros(len(depth), np.bool_)
        else:
            # Albedo: what a linear source with few moments leaves out adds up where light is
            # scattered often. albedo^2 depth is about what is scattered twice in the cell.
            chains = (depth > deep) | (albedo > tuning.path_albedo)
            chains |= albedo**2 * depth > tuning.path_twice * deep
            chains &= scatters
        real = source.dtype.type
        sent = np.zeros((len(source), len(address)), real)
        first, emission = cells.needs.boundaries, cells.thermal_planes(real, address)
        sent[first : first + len(emission)] = emission
        sent[:, scatters] = source[:, number[scatters]]
        across = np.zeros((0, len(address)), real)
        if changes is not None:
            among = np.full(len(cells.address), NONE)
            among[linear_cells] = np.arange(len(linear_cells))
            among = np.where(scatters, among[number], NONE)
            across = changes.reshape(-1, len(linear_cells))[:, among] * (among >= 0).astype(real)
        sent[first : first + len(emission), chains] -= emission[:, chains]
        scattered = np.where(chains, cells.albedo[number], 1.0).astype(real)
        emitted = np.zeros((len(cells.needs.components), len(address)), real)
        emitted[first : first + len(emission)] = chains * seen.thermal_planes(real, address)
        planes = [emitted, *(sent / scattered).reshape(-1, len(emitted), len(address))]
        planes.extend((across / scattered).reshape(-1, len(emitted), len(address)))
        fours = -(-len(emitted) // 4) * 4
        out = np.zeros((len(self.at), _HEAD + fours * len(planes)), real)
        out[stored, 0] = np.where(chains, seen.depth[address], cells.depth[address])
        out[stored, 1] = np.where(chains, seen.albedo[number], 0.0)
        for place, plane in enumerate(planes):
            begin = _HEAD + place * fours
            out[stored, begin : begin + len(plane)] = plane.T
        return out
