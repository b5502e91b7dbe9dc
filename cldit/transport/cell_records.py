"""Records of the non-empty cells as kernels/image.cl reads them (stage 4 of `trace_source`).

All that a line of sight needs of a cell lies side by side: a cell costs one access to memory, not
one for each component and image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import OpticalCells

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CellRecords:
    """The non-empty cells, those that scatter first.

    at: (F,) their addresses. number: (P,) int32 row of each stored cell, -1 where it is empty.
    linear: whether the extinction is linear in cells.
    """

    cells: OpticalCells
    at: NDArray[np.int64]
    number: NDArray[np.int32]
    linear: bool = False

    @classmethod
    def of(cls, cells: OpticalCells, *, linear: bool = False) -> CellRecords:
        """Of all stored cells of optical depth above 0; `linear` as in `CellRecords`."""
        others = cells.depth > 0
        others[cells.address] = False
        at = np.concatenate([cells.address, np.flatnonzero(others)])
        number = np.full(len(cells.depth), -1, np.int32)
        number[at] = np.arange(len(at))
        return cls(cells, at, number, linear)

    def records(
        self,
        listed: list[NDArray[np.floating] | None],
        defect: Floats,
        thick: NDArray[np.int64] | None,
        real: type[np.floating],
    ) -> NDArray[np.floating]:
        """(F, R) records of the cells, in the type `real`.

        A record has the optical depth of the cell's edge; its relative gradient where it is linear;
        with `thick`, the albedo of thick cells, else 0; and for each image the source of all
        components and the emission at radiance 1. Where nothing scatters it has emitters alone; the
        emission at radiance 1 is then 1.

        Args:
            listed, defect: as in `FormalSolution.images`.
            thick: (T,) which scattering cells the final gather refines; None: there is no gather.
            real: the device's precision.
        """
        cells, needs = self.cells, self.cells.needs
        thermal = cells.thermal_planes(real, self.at).T
        head = cells.depth[self.at, None].astype(real)
        if self.linear:
            head = np.column_stack([head, cells.extinction_gradient[self.at].astype(real)])
        if not needs.scattering:
            return np.column_stack([head, thermal])
        albedo_at = head.shape[1]
        first = albedo_at if thick is None else albedo_at + 1
        parts = len(needs.components) + 1
        out = np.zeros((len(self.at), first + parts * len(listed)), real)
        out[:, :albedo_at] = head
        row = self.number[cells.address]
        if thick is not None:
            out[row[thick], albedo_at] = cells.albedo[thick]
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
                # The gather adds what is scattered.
                value[thick, :-1] = 0.0
                value[thick, -1] = (cells.coalbedo + made)[thick]
                value[thick, needs.boundaries : -1] = thermal[row[thick]]
            mine[row] = value
        return out
