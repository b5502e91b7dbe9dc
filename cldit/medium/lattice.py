"""Boxes on a regular lattice: their overlaps with cells are a product of one matrix per axis."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from cldit.arrays import Floats, Ints

_FEWEST = 1000  # boxes; with fewer, pairs are as fast
_SPARSEST = 16  # lattice points per box; with more, the dense lattice is slower than the pairs
_FINEST = 1e-2  # of a cell; a finer lattice would consist of slivers
TOLERANCE = 1e-5  # in cells: largest distance of a box from its lattice point
_SLIVER = 1e-6  # in cells: the neighbour receives smaller overlaps


@dataclass(frozen=True)
class Lattice:
    """Lattice of boxes.

    place: (N,) flat [z, y, x] lattice point of each box. shape: lattice points along z, y, x.
    shares: for x, y, z the (cells, points) share of each point's interval in each cell; columns
    sum to 1. first: first cell along x, y, z.
    """

    place: Ints
    shape: tuple[int, int, int]
    shares: "tuple[scipy.sparse.csr_array, scipy.sparse.csr_array, scipy.sparse.csr_array]"
    first: tuple[int, int, int]

    @classmethod
    def of(cls, lower: Floats, upper: Floats) -> "Lattice | None":
        """Lattice of boxes from `lower` to `upper` (N, 3) in cells; None if there is none."""
        if len(lower) < _FEWEST:
            return None
        # One axis at a time, since numpy is ten times slower with rows of three.
        origin, spacing = np.array([axis.min() for axis in lower.T]), upper[0] - lower[0]
        if spacing.min() < _FINEST:
            return None
        index = []
        for low, high, begin, step in zip(lower.T, upper.T, origin, spacing, strict=True):
            steps = (low - begin) / step
            index.append(np.rint(steps).astype(np.int64))
            off = np.abs(steps - index[-1]).max() * step
            if np.abs(high - low - step).max() > TOLERANCE or off > TOLERANCE:
                return None
        nx, ny, nz = (int(points.max()) + 1 for points in index)
        if nx * ny * nz > _SPARSEST * len(lower):
            return None
        parts = [_axis(float(origin[a]), float(spacing[a]), n) for a, n in enumerate((nx, ny, nz))]
        return cls(
            place=(index[2] * ny + index[1]) * nx + index[0],
            shape=(nz, ny, nx),
            shares=(parts[0][1], parts[1][1], parts[2][1]),
            first=(parts[0][0], parts[1][0], parts[2][0]),
        )

    def layers(self, amounts: list[Floats]) -> Iterator[tuple[int, list[Floats]]]:
        """Yields the z of each layer of cells and the sums [y, x] of each amount (N,) in it.

        Only a few planes are processed at a time, which stay in the cache.
        """
        nz, ny, nx = self.shape
        along_x, along_y, along_z = self.shares
        in_layer, inside = np.divmod(self.place, ny * nx)
        # A stable sort of 16-bit integers takes one pass.
        order = np.argsort(in_layer.astype(np.min_scalar_type(nz)), kind="stable")
        ends = np.append(0, np.cumsum(np.bincount(in_layer, minlength=nz)))
        by_layer = along_z.tocsc()
        sums: dict[int, list[Floats]] = {}
        for layer in range(nz):
            members = order[ends[layer] : ends[layer + 1]]
            planes = []
            for amount in amounts:
                points = np.bincount(inside[members], amount[members], minlength=ny * nx)
                across = (along_x @ points.reshape(ny, nx).T).T  # (ny, cx)
                planes.append(along_y @ across)  # (cy, cx)
            column = slice(*by_layer.indptr[layer : layer + 2])
            touched = by_layer.indices[column].tolist()
            for cell in [cell for cell in sums if cell < min(touched)]:
                yield self.first[2] + cell, sums.pop(cell)
            for cell, share in zip(touched, by_layer.data[column], strict=True):
                parts = [share * plane for plane in planes]
                if cell in sums:
                    parts = [old + part for old, part in zip(sums[cell], parts, strict=True)]
                sums[cell] = parts
        for cell, totals in sums.items():
            yield self.first[2] + cell, totals


def _axis(origin: float, spacing: float, count: int) -> "tuple[int, scipy.sparse.csr_array]":
    """First touched cell, and the shares of `count` intervals in the cells from there on."""
    low = origin + spacing * np.arange(count)
    high = low + spacing
    begin = int(np.floor(low[0] + _SLIVER))
    cells = max(1, int(np.ceil(high[-1] - _SLIVER)) - begin)
    reach = int(np.ceil(spacing)) + 1
    start = np.floor(low + _SLIVER).astype(int) - begin
    point = np.repeat(np.arange(count), reach)
    cell = (start[:, None] + np.arange(reach)).ravel()
    share = np.minimum(high[point], begin + cell + 1.0) - np.maximum(low[point], begin + cell)
    keep = (share > _SLIVER) & (cell < cells)
    matrix = scipy.sparse.csr_array((share[keep], (cell[keep], point[keep])), shape=(cells, count))
    return begin, scipy.sparse.csr_array(matrix / np.asarray(matrix.sum(axis=0))[None, :])
