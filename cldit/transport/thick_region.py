"""Thick region: thick cells, and the cells around them that path segments cross.

The final gather (stage 5 of `trace_source`) refines it. The neighbours of a thick cell, or cells
beyond a gap, cast shadows that are smaller than a cell. So path segments cross the cells around
thick ones, and end at the interfaces of this region.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.transport.cells import OpticalCells, SweptBox, numbered
from cldit.transport.tuning import Tuning

NONE, OUTSIDE = -1, -2
_INTERFACE = -2  # less the number of an interface, as in path_segment.h
_HEAD = 4  # numbers of a record before its planes, which are in fours, as in cell_record.h


@dataclass(frozen=True)
class ThickRegion:
    """Thick cells of the swept box, and the region of these and of the cells around them.

    listed: (T,) numbers of the thick cells among the scattering ones.
    at: (R, 3) the region's cells in the box.
    address: (R,) addresses of these among stored cells; -1: not stored.
    low: (3,) lower corner, in the box, of the part around the region.
    places: (z, y, x) number of the region's cell at each place of that part; -1: none.
    beside: (R, 6) neighbours of each cell, as in kernels/path_segment.h.
    interfaces: number of interfaces, whose radiance the final sweeps store.
    diffusive: true if light diffuses in thick cells, where the sweeps' sources are inaccurate.
    """

    listed: NDArray[np.int64]
    at: NDArray[np.int64]
    address: NDArray[np.int64]
    low: NDArray[np.int64]
    places: NDArray[np.int32]
    beside: NDArray[np.int32]
    interfaces: int
    diffusive: bool = False

    @classmethod
    def of(
        cls,
        cells: OpticalCells,
        box: SweptBox,
        *,
        deeper_than: float,
        tuning: Tuning,
        asymmetry: float | NDArray[np.float64] = 0.0,
    ) -> "ThickRegion | None":
        """Thick scattering cells and the cells around them; None if no cell is thick.

        Args:
            deeper_than: optical depth of a cell's edge above which it is thick.
            tuning: `margin` cells around thick ones; limits of `diffusive` cells.
            asymmetry: mean cosine of scattering, of all cells or (N,).
        """
        listed = np.flatnonzero(cells.depth[cells.address] > deeper_than)
        if not len(listed):
            return None
        thick_places = cells.positions(cells.address[listed]) - np.asarray(box.low)
        low = np.maximum(thick_places.min(axis=0) - tuning.margin - 1, 0)
        high = np.minimum(thick_places.max(axis=0) + tuning.margin + 2, box.shape)
        thick = np.zeros((high - low)[::-1], bool)
        thick[tuple((thick_places - low).T[::-1])] = True
        region = scipy.ndimage.binary_dilation(thick, iterations=tuning.margin)
        places = np.full(region.shape, NONE, np.int32)
        places[region] = np.arange(np.count_nonzero(region))
        at = np.argwhere(region)[:, ::-1]
        padded = np.pad(places, 1, constant_values=OUTSIDE)
        beside = np.full((len(at), 6), NONE, np.int32)
        interfaces = 0
        for axis in range(3):
            ends = []
            for up in (0, 1):
                neighbour = at.T + 1
                neighbour[axis] += 2 * up - 1
                number = padded[tuple(neighbour[::-1])]
                ends_there = number == NONE
                ends.append(interfaces + int(np.count_nonzero(ends_there)))
                number = np.where(number == OUTSIDE, NONE, number)
                number[ends_there] = _INTERFACE - np.arange(interfaces, ends[-1])
                beside[:, 2 * axis + up] = number
            interfaces = max(ends)
        loss = cells.coalbedo[listed]
        loss = loss / (loss + ((1.0 - asymmetry) * cells.albedo)[listed])
        deep = cells.depth[cells.address[listed]] > tuning.diffuse_depth
        diffusive = bool(np.any(deep & (loss < tuning.diffuse_coalbedo)))
        at += low
        address = cells.stored(at + np.asarray(box.low))
        return cls(listed, at, address, low, places, beside, interfaces, diffusive)

    @property
    def faces(self) -> NDArray[np.int32]:
        """Numbers (R, 6) of interfaces: faces to cells of the box outside the region; -1: others.

        Two faces that no direction crosses outwards may share a number, because segments end in
        the radiance of an ordinate of their own octant.
        """
        return np.where(self.beside <= _INTERFACE, _INTERFACE - self.beside, NONE)

    def records(
        self,
        seen: OpticalCells,
        cells: OpticalCells,
        source: NDArray[np.floating],
        gradient: NDArray[np.floating] | None,
        linear_cells: NDArray[np.intp],
        *,
        path_depth: float | None,
        tuning: Tuning,
    ) -> NDArray[np.floating]:
        """Records (R, ...) of the region's cells, as in kernels/cell_record.h.

        A record contains the optical depth, the source of the final sweeps, and its gradient. Where
        paths continue it also has albedo and emission, and the source is the scattered part over
        the albedo. Cells that are not stored are empty.

        Args:
            seen, cells: the original medium, and that of the final sweeps.
            source: (M C, N) source of the scattering cells.
            gradient: (3, C, K) of the source in `linear_cells`, or None.
            linear_cells: (K,) numbers of the scattering cells that have a gradient.
            path_depth: optical depth from which paths continue in a cell; None: in no cell, at a
                fixed order, since each segment of a path is one more order.
            tuning: `path_albedo` and `path_twice`, further criteria.
        """
        stored = self.address >= 0
        address = self.address[stored]
        number = numbered(cells.address, len(cells.depth))[address]
        scatters = number >= 0
        depth, albedo = seen.depth[address], seen.albedo[number]
        continues = scatters & _continues(depth, albedo, path_depth, tuning)
        real = source.dtype.type
        own_source = np.zeros((len(source), len(address)), source.dtype)
        first_emitter, emission = cells.needs.boundaries, cells.thermal_planes(real, address)
        emitters = slice(first_emitter, first_emitter + len(emission))
        own_source[emitters] = emission
        own_source[:, scatters] = source[:, number[scatters]]
        own_gradient = np.zeros((0, len(address)), real)
        if gradient is not None:
            among = numbered(linear_cells, len(cells.address))
            among = np.where(scatters, among[number], NONE)
            listed = gradient.reshape(-1, len(linear_cells))[:, among]
            own_gradient = listed * (among >= 0).astype(real)
        own_source[emitters, continues] -= emission[:, continues]
        scattered = np.where(continues, cells.albedo[number], 1.0).astype(real)
        emitted = np.zeros((len(cells.needs.components), len(address)), real)
        emitted[emitters] = continues * seen.thermal_planes(real, address)
        planes = [emitted, *(own_source / scattered).reshape(-1, len(emitted), len(address))]
        planes.extend((own_gradient / scattered).reshape(-1, len(emitted), len(address)))
        fours = -(-len(emitted) // 4) * 4
        out = np.zeros((len(self.at), _HEAD + fours * len(planes)), real)
        out[stored, 0] = np.where(continues, depth, cells.depth[address])
        out[stored, 1] = np.where(continues, albedo, 0.0)
        for place, plane in enumerate(planes):
            begin = _HEAD + place * fours
            out[stored, begin : begin + len(plane)] = plane.T
        return out


def _continues(depth: Floats, albedo: Floats, path_depth: float | None, tuning: Tuning) -> Mask:
    """Mask (N,) of cells in which paths continue.

    Errors of a linear source with few moments accumulate over many scatterings. albedo^2 depth is
    about the light that is scattered twice in the cell.
    """
    if path_depth is None:
        return np.zeros(len(depth), np.bool_)
    twice = albedo**2 * depth > tuning.path_twice * path_depth
    return (depth > path_depth) | (albedo > tuning.path_albedo) | twice
