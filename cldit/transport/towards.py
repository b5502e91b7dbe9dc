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
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.groups import Groups, turned_too
from cldit.transport.reference import mean_transmission
from cldit.transport.thick import RimLight


@dataclass(frozen=True)
class ToCamera:
    """A sweep for the light that cells scatter towards the camera.

    place: of the camera, in cells of the cube. seen, even: optical depths as the camera sees them,
    and 1 over the mean transmission of each, in groups of either order; shares: sum of weights in
    every cell, likewise.
    """

    device: Device
    real: type[np.float32] | type[np.float64]
    program: Program
    phase: Any
    place: NDArray[np.float64]
    seen: dict[bool, Any]
    even: dict[bool, Any]
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
        groups: Mapping[bool, Groups],
        *,
        phase: NDArray[np.float64],
        place: NDArray[np.float64],
    ) -> ToCamera:
        """program: sweep.cl, with TO_CAMERA; medium: as the camera sees it; phase: even in the sine
        of half the angle, or a single number where the program has no PHASE_STEPS."""

        def in_groups(values: NDArray[np.float64]) -> dict[bool, Any]:
            dense = turned_too(medium.dense(box, values.astype(real)))
            return {
                turned: upload(device, "optical depth", some.packed(dense[turned]))
                for turned, some in groups.items()
            }

        return cls(
            device=device,
            real=real,
            program=program,
            phase=upload(device, "phase function", phase.astype(real)),
            place=place,
            seen=in_groups(medium.depth),
            even=in_groups(1.0 / mean_transmission(medium.depth)),
            shares={
                turned: zeros(device, "shares", some.cells, real) for turned, some in groups.items()
            },
        )
