"""What a sweep needs that finds the light which cells scatter towards the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.thick import RimLight


@dataclass(frozen=True)
class ToCamera:
    """A sweep for the light that cells scatter towards the camera.

    place: of the camera, in cells of the cube. seen: optical depths as the camera sees them, and
    their turned copy; shares: sum of weights in every cell, likewise.
    """

    device: Device
    real: type[np.float32] | type[np.float64]
    kernel: Any
    phase: Any
    place: NDArray[np.float64]
    seen: dict[bool, Any]
    shares: dict[bool, Any]
    light: RimLight | None = None  # where the light that leaves the rim is kept

    @classmethod
    def of(
        cls,
        device: Device,
        box: Box,
        real: type[np.float32] | type[np.float64],
        program: Program,
        medium: OpticalCells,
        *,
        phase: NDArray[np.float64],
        place: NDArray[np.float64],
    ) -> ToCamera:
        """program: sweep.cl, with TO_CAMERA; medium: as the camera sees it; phase: even in the sine
        of half the angle, or a single number where the program has no PHASE_STEPS."""
        depth = medium.dense(box, medium.depth.astype(real))
        return cls(
            device=device,
            real=real,
            kernel=program["sweep"],
            phase=upload(device, "phase function", phase.astype(real)),
            place=place,
            seen={
                False: upload(device, "optical depth", depth),
                True: upload(device, "optical depth", depth.transpose(2, 0, 1)),
            },
            shares={turned: zeros(device, "shares", box.cells, real) for turned in (False, True)},
        )
