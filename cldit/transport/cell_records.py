"""Records of the non-empty cells as kernels/image.cl reads them (stage 4 of `trace_source`).

All that a line of sight needs of a cell lies side by side: a cell costs one access to memory, not
one for each component and image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gradients import limit
from cldit.transport.linear_coefficients import MOST

Floats = NDArray[np.float64]
_TOGETHER = 2**18  # cells


@dataclass(frozen=True)
class CellRecords:
    """The non-empty cells, those that scatter first.

    at: (F,) their addresses. number: (P,) int32 row of each stored cell, -1 where it is empty.
    linear: whether coefficients are linear in cells.
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

    def linear_sources(
        self,
        listed: list[NDArray[np.floating] | None],
        gradient: NDArray[np.floating] | None,
        thick: NDArray[np.int64] | None,
    ) -> tuple[list[NDArray[np.floating] | None], NDArray[np.floating]]:
        """Sources in the cells' middles, and their gradients, where coefficients are linear.

        Args:
            listed, thick: as in `records`; all sources are None or none is.
            gradient: (3, C, N) of the radiance's part of the sources; None: it is constant.

        Returns:
            Sources (C, N) for `records`; and (F, 3 S) gradients of the S components that begin in
            cells, of thick cells those of the emission alone.
        """
        cells, needs = self.cells, self.cells.needs
        linear, inner = cells.linear, needs.boundaries
        first = 0 if needs.scattering else inner
        parts = len(needs.components)
        count = 0 if not listed or listed[0] is None else len(cells.address)
        out = [None if source is None else np.array(source) for source in listed]
        table = np.empty((len(self.at), 3, parts - first), np.float32)
        own = np.zeros(len(self.at), bool)
        if thick is not None:
            own[thick] = True
        for begin in range(0, len(self.at), _TOGETHER):  # for memory
            some = slice(begin, min(begin + _TOGETHER, len(self.at)))
            at = self.at[some]
            emitted = np.zeros((parts, len(at)), np.float32)
            emitted[inner:] = cells.thermal_planes(np.float32, at)
            change = np.zeros((3, parts, len(at)), np.float32)
            for number, name in enumerate(needs.emitters, inner):
                if name in linear.emission:
                    change[:, number] = emitted[number] * linear.emission[name][at].T
            known = slice(begin, max(min(some.stop, count), begin))
            if known.stop > known.start:
                whole = emitted.copy()
                mine = slice(0, known.stop - known.start)
                whole[:, mine] = np.mean([one[:, known] for one in out if one is not None], axis=0)
                total = change + (whole - emitted) * linear.albedo[at].T[:, None]
                if gradient is not None:
                    total[:, :, mine] += gradient[:, :, known]
                limit(total, whole / np.float32(MOST), inner)
                total[:, :, own[some]] = change[:, :, own[some]]
                change = total
                across = np.einsum("ip,icp->cp", linear.extinction[at].T, change)
                across *= linear.edge[at] ** 2 / np.float32(12)
                for source in out:
                    if source is not None:
                        source[:, known] -= across[:, mine]
            table[some] = change[:, first:].transpose(2, 0, 1)
        return out, table.reshape(len(self.at), -1)

    def _thermal(self, real: type[np.floating]) -> NDArray[np.floating]:
        """Emission over extinction (E, F), in the cells' middles."""
        planes = self.cells.thermal_planes(real, self.at)
        if self.linear:
            linear = self.cells.linear
            for plane, name in zip(planes, self.cells.needs.emitters, strict=True):
                if name in linear.emission:
                    plane *= linear.middle(linear.emission[name])[self.at]
        return planes

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
        thermal = self._thermal(real).T
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
