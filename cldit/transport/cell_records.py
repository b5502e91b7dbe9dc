"""The stored cells that hold anything, and their records as kernels/image.cl reads them.

What a line of sight needs of a cell lies side by side, so that a cell costs one access to memory,
not one for each part of the light and each picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import OpticalCells

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CellRecords:
    """at (F,): addresses of the cells, those that scatter first; number (P,) int32: of a stored
    cell among them, or -1."""

    cells: OpticalCells
    at: NDArray[np.int64]
    number: NDArray[np.int32]

    @classmethod
    def of(cls, cells: OpticalCells) -> CellRecords:
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
        control_variate: NDArray[np.floating] | None,
        real: type[np.floating],
    ) -> NDArray[np.floating]:
        """(F, R): optical depth of a cell's edge; with `thick`, albedo of thick cells, else 0; and
        for each picture its source, and the source of what is emitted at radiance 1.

        listed, defect, thick, control_variate: as in `FormalSolution.images`. Where nothing
        scatters
        the source
        has emitters alone, and what is emitted at radiance 1 is not stored: it is 1.
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
        for picture, source in enumerate(listed):
            mine = out[:, first + parts * picture : first + parts * (picture + 1)]
            mine[:, needs.boundaries : -1] = thermal
            mine[:, -1] = 1.0
            if source is None:
                continue
            one_minus_lambda = cells.albedo * defect
            value = np.empty((len(row), parts), real)
            value[:, :-1] = source.T
            value[:, -1] = (
                1.0 - source[: needs.boundaries].sum(axis=0, dtype=np.float64) + one_minus_lambda
            )
            if thick is not None:
                # Flights find what is scattered, or what it is more than what was expected.
                value[thick, :-1] = 0.0
                value[thick, -1] = (cells.coalbedo + one_minus_lambda)[thick]
                if control_variate is not None:
                    sent = cells.albedo[thick] * control_variate
                    value[thick, :-1] = sent.T
                    outside = sent[: needs.boundaries].sum(axis=0)
                    value[thick, -1] += cells.albedo[thick] - outside
                value[thick, needs.boundaries : -1] += thermal[row[thick]]
            mine[row] = value
        return out
