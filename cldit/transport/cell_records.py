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
    """

    cells: OpticalCells
    at: NDArray[np.int64]
    number: NDArray[np.int32]

    @classmethod
    def of(cls, cells: OpticalCells) -> CellRecords:
        """Of all stored cells of optical depth above 0."""
        others = cells.depth > 0
        others[cells.address] = False
        at = np.concatenate([cells.address, np.flatnonzero(others)])
        number = np.full(len(cells.depth), -1, np.int32)
        number[at] = np.arange(len(at))
        return cls(cells, at, number)

    def records(
        self,
        listed: list[NDArray[np.floating] | None],
        defect: Floats,
        thick: NDArray[np.int64] | None,
        real: type[np.floating],
    ) -> NDArray[np.floating]:
        """(F, R) records of the cells, in the type `real`.

        A record has the optical depth of the cell's edge; with `thick`, the albedo of thick cells,
        else 0; and for each image the source of all components and the emission at radiance 1.
        Where nothing scatters it has emitters alone; the emission at radiance 1 is then 1.

        Args:
            listed, defect: as in `FormalSolution.images`.
            thick: (T,) which scattering cells the final gather refines; None: there is no gather.
            real: the device's precision.
        """
        cells, needs = self.cells, self.cells.needs
        thermal = cells.thermal_planes(real, self.at).T
        first = 1 if thick is None else 2
        if not needs.scattering:
            return np.column_stack([cells.depth[self.at].astype(real), thermal])
        parts = len(needs.components) + 1
        out = np.zeros((len(self.at), first + parts * len(listed)), real)
        out[:, 0] = cells.depth[self.at]
        row = self.number[cells.address]
        if thick is not None:
            out[row[thick], 1] = cells.albedo[thick]
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
