"""Records of the non-empty cells as kernels/image.cl reads them (stage 4 of `trace_source`).

All values that a line of sight needs of a cell are contiguous: a cell costs one memory access, not
one for each component and image.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Reals
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.limiter import limit
from cldit.transport.linear_coefficients import MOST

_TOGETHER = 2**18  # cells


@dataclass(frozen=True)
class CellRecords:
    """The non-empty cells; those that scatter come first.

    at: (F,) addresses. number: (P,) int32 row of each stored cell, -1 if it is empty.
    linear: true if coefficients are linear in cells.
    """

    cells: OpticalCells
    at: Ints
    number: NDArray[np.int32]
    linear: bool = False

    @classmethod
    def of(cls, cells: OpticalCells, *, linear: bool = False) -> "CellRecords":
        """Records of all stored cells of optical depth above 0; `linear` as in the class."""
        others = cells.depth > 0
        others[cells.address] = False
        at = np.concatenate([cells.address, np.flatnonzero(others)])
        number = np.full(len(cells.depth), -1, np.int32)
        number[at] = np.arange(len(at))
        return cls(cells, at, number, linear)

    def linear_sources(
        self,
        listed: list[Reals | None],
        gradient: Reals | None,
        thick: Ints | None,
    ) -> tuple[list[Reals | None], Reals]:
        """Sources in the middles of cells and their gradients, where coefficients are linear.

        Args:
            listed, thick: as in `records`; either all sources are None or none is.
            gradient: (3, C, N) of the scattered part of the sources; None: it is constant.

        Returns:
            Sources (C, N) for `records`, and (F, 3 S) gradients of the S components that cells
            emit. In thick cells the emission has its own gradient, and the first boundary's place
            has the albedo's, which shifts light between the emission and the gather.
        """
        cells, needs, linear = self.cells, self.cells.needs, self.cells.linear
        first = 0 if needs.scattering else needs.boundaries
        out = [None if source is None else np.array(source) for source in listed]
        sources = [source for source in out if source is not None]
        count = len(cells.address) if sources else 0
        table = np.zeros((len(self.at), 3, len(needs.components) - first), np.float32)
        for begin in range(0, len(self.at), _TOGETHER):
            some = slice(begin, min(begin + _TOGETHER, len(self.at)))
            at = self.at[some]
            change = np.zeros((3, len(needs.components), len(at)), np.float32)
            change[:, needs.boundaries :] = linear.emission[:, at].transpose(2, 0, 1)
            known, mine = slice(begin, min(some.stop, count)), slice(0, max(count - begin, 0))
            if mine.stop:
                mean = np.mean([source[:, known] for source in sources], axis=0)
                light = mean.copy()
                light[needs.boundaries :] -= cells.thermal_planes(np.float32, at[mine])
                light /= cells.albedo[known].astype(np.float32)
                own = change[:, :, mine] + light * linear.albedo[at[mine]].T[:, None]
                if gradient is not None:
                    own += gradient[:, :, known]
                edge = linear.edge[at[mine]]
                own *= edge
                limit(own, mean / np.float32(MOST), needs.boundaries)
                excess = np.einsum("pi,icp->cp", linear.extinction[at[mine]], own) * edge
                for source in sources:
                    source[:, known] -= excess / np.float32(12)
                change[:, :, mine] = own / edge
            table[some] = change[:, first:].transpose(2, 0, 1)
        if thick is not None:
            at = cells.address[thick]
            table[thick] = 0.0
            table[thick, :, 0] = linear.albedo[at]
            table[thick, :, needs.boundaries :] = linear.emission[:, at].transpose(1, 2, 0)
        return out, table.reshape(len(self.at), 3 * table.shape[2])

    def records(
        self,
        listed: list[Reals | None],
        defect: Floats,
        thick: Ints | None,
        real: type[np.floating],
    ) -> Reals:
        """Records (F, R) of the cells, in the type `real`.

        A record contains the optical depth of the cell's edge; its relative gradient if linear;
        with `thick`, the albedo of thick cells, else 0; and for each image the source of all
        components and the emission at radiance 1. If nothing scatters, it contains emitters only,
        and the emission at radiance 1 is 1.

        Args:
            listed, defect: as in `FormalSolution.images`.
            thick: (T,) the scattering cells that the final gather refines; None: no gather.
            real: the device's precision.
        """
        cells, needs = self.cells, self.cells.needs
        middles = cells.middles() if self.linear else cells
        thermal = middles.thermal_planes(real, self.at).T
        head = cells.depth[self.at, None].astype(real)
        if self.linear:
            head = np.column_stack([head, cells.linear.extinction[self.at].astype(real)])
        if not needs.scattering:
            return np.column_stack([head, thermal])
        albedo_at = head.shape[1]
        first = albedo_at if thick is None else albedo_at + 1
        parts = len(needs.components) + 1
        out = np.zeros((len(self.at), first + parts * len(listed)), real)
        out[:, :albedo_at] = head
        row = self.number[cells.address]
        if thick is not None:
            out[row[thick], albedo_at] = middles.albedo[thick]
        for image, source in enumerate(listed):
            mine = out[:, first + parts * image : first + parts * (image + 1)]
            mine[:, needs.boundaries : -1] = thermal
            mine[:, -1] = 1.0
            if source is None:
                continue
            made = cells.albedo * defect
            value = np.empty((len(row), parts), real)
            value[:, :-1] = source.T
            outside = source[: needs.boundaries].sum(axis=0, dtype=np.float64)
            value[:, -1] = 1.0 - outside + made
            if thick is not None:
                # The gather adds the scattered light.
                value[thick, :-1] = 0.0
                value[thick, -1] = (middles.coalbedo + made)[thick]
                value[thick, needs.boundaries : -1] = thermal[row[thick]]
            mine[row] = value
        return out
