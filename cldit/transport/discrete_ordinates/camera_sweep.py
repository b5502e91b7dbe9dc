"""What a sweep needs that finds the light which cells scatter towards the camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.attenuation import mean_transmission
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import CellPackets, turned_too


@dataclass(frozen=True)
class CameraSweep:
    """A sweep for the light that cells scatter towards the camera.

    place: of the camera, in cells of the cube. shares: sum of weights in every cell, in groups of
    either order; seen, with VIEW_TRANSMISSION: optical depths as the camera sees them, and 1 over
    the mean
    transmission of each, likewise.
    """

    device: Device
    real: type[np.float32] | type[np.float64]
    program: Program
    phase: Any
    place: NDArray[np.float64]
    shares: dict[bool, Any]
    seen: dict[bool, dict[str, Any]]

    @classmethod
    def of(
        cls,
        device: Device,
        box: Box,
        real: type[np.float32] | type[np.float64],
        program: Program,
        medium: OpticalCells,
        groups: Mapping[bool, CellPackets],
        *,
        phase: NDArray[np.float64],
        place: NDArray[np.float64],
    ) -> CameraSweep:
        """program: sweep.cl, with CAMERA_SWEEP; medium: as the camera sees it; phase: even in the
        sine
        of half the angle, or a single number where the program has no PHASE_STEPS."""

        seen: dict[bool, dict[str, Any]] = {turned: {} for turned in groups}
        if "VIEW_TRANSMISSION" in program.defines:
            asked = {"seen": medium.depth, "even": 1.0 / mean_transmission(medium.depth)}
            for name, values in asked.items():
                dense = turned_too(medium.dense(box, values.astype(real)))
                for turned, some in groups.items():
                    packed = some.packed(dense[turned])
                    seen[turned][name] = upload(device, "optical depth", packed)
        return cls(
            device=device,
            real=real,
            program=program,
            phase=upload(device, "phase function", phase.astype(real)),
            place=place,
            shares={
                turned: zeros(device, "shares", some.cells, real) for turned, some in groups.items()
            },
            seen=seen,
        )
