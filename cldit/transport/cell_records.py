"""Records of the non-empty cells as kernels/image.cl reads them (stage 4 of `trace_source`).

All values that a line of sight needs of a cell are contiguous: a cell costs one memory access, not
one for each component and image. The kernel `cell_records` writes them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Reals
from cldit.gpu.buffers import unset, upload
from cldit.gpu.program import GROUP, Program
from cldit.medium.frame import CELLS_PER_BRICK
from cldit.transport.cells import OpticalCells, numbered
from cldit.transport.linear_coefficients import device_cells


@dataclass(frozen=True)
class CellRecords:
    """The non-empty cells; those that scatter come first.

    count: number of them. number: (P,) int32 row of each stored cell, -1 if it is empty.
    """

    cells: OpticalCells
    count: int
    number: NDArray[np.int32]

    @classmethod
    def of(cls, cells: OpticalCells) -> "CellRecords":
        """Records of all stored cells of optical depth above 0."""
        absorbing = cells.depth > 0
        absorbing[cells.address] = False
        at = np.concatenate([cells.address, np.flatnonzero(absorbing)])
        return cls(cells, len(at), numbered(at, len(cells.depth)))

    def upload(
        self,
        program: Program,
        number: Any,
        listed: list[Reals],
        defect: Floats,
        *,
        spatial: bool,
        thick: Ints | None = None,
        known: tuple[Ints, Reals] | None = None,
    ) -> dict[str, Any]:
        """Writes the records on the program's device; returns arguments of the image's kernels.

        Args:
            program: image.cl. number: buffer of the rows.
            listed, defect, known: as of `FormalSolution.with_sources`.
            spatial: sources have spatial gradients.
            thick: (T,) the scattering cells that the final gather refines, with GATHER.
        """
        device, real, needs = program.device, program.real, self.cells.needs
        defines, parts, inner = program.defines, len(needs.components), len(self.cells.address)
        linear = "LINEAR_COEFFICIENTS" in defines
        per_image = parts + 1 if needs.scattering else len(needs.emitters)
        size = 1 + 3 * linear + ("GATHER" in defines) + int(defines["IMAGES"]) * per_image
        out = {"records": unset(device, "records", size * self.count, real)}
        arguments: dict[str, Any] = {}
        if needs.scattering:
            arguments |= {
                "sources": upload(device, "sources", np.stack(listed).astype(real)),
                "defect": upload(device, "defect", defect.astype(real)),
                "cells": inner,
            }
        if "GATHER" in defines:
            flags = np.zeros(inner, np.uint8)
            flags[thick] = 1
            arguments["thick"] = upload(device, "thick cells", flags)
        if "LINEAR_SOURCE" in defines:
            rows = self.count if linear else inner
            of_cell = 3 * (parts if needs.scattering else len(needs.emitters))
            out["gradient"] = unset(device, "gradient", of_cell * rows, real)
        if "LINEAR_SOURCE" in defines and needs.scattering:
            arguments |= {**self._known(program, known), "spatial": int(spatial)}
        program.launch(
            "cell_records",
            (len(self.number),),
            (GROUP,),
            {
                **out,
                **arguments,
                **device_cells(device, self.cells, real, linear=linear),
                "number": number,
                "bricks": self.cells.tree.frame.bricks,
                "coarse": self.cells.tree.slots * CELLS_PER_BRICK,
                "stored": len(self.number),
            },
        )
        return {**out, "scattering": rows} if "LINEAR_SOURCE" in defines else out

    def _known(self, program: Program, known: tuple[Ints, Reals] | None) -> dict[str, Any]:
        """Kernel arguments of the known gradients of the radiance."""
        device, parts = program.device, len(self.cells.needs.components)
        at, gradient = known or (np.zeros(0, np.int64), np.zeros((3, parts, 0), program.real))
        return {
            "known": upload(device, "linear cells", numbered(at, len(self.cells.address))),
            "known_gradient": upload(device, "spatial gradient", gradient.astype(program.real)),
            "known_cells": len(at),
        }
