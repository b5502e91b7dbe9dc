"""Weights for scattering to the camera in the final sweeps (stage 3 of `trace_source`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.cells import OpticalCells, SweptBox, mean_transmission
from cldit.transport.discrete_ordinates.cell_packets import CellPackets, turned_too


@dataclass(frozen=True)
class CameraSweep:
    """Sweep program that weights ordinates by the scattering to the camera.

    phase: phase function in equal steps of the sine of half the angle.
    place: (3,) position of the camera, in cells of the cube.
    shares: sums of weights in every cell, in packets of either order of axes.
    seen: with VIEW_TRANSMISSION, optical depths to the camera and inverse mean transmissions; with
        BLURRED_BOUNDARY, optical depths; with PHASE_CLASSES, shares of the droplet size classes.
    """

    device: Device
    real: type[np.float32] | type[np.float64]
    program: Program
    phase: Any
    place: Floats
    shares: dict[bool, Any]
    seen: dict[bool, dict[str, Any]]

    @classmethod
    def of(
        cls,
        device: Device,
        box: SweptBox,
        real: type[np.float32] | type[np.float64],
        program: Program,
        medium: OpticalCells,
        packets: Mapping[bool, CellPackets],
        *,
        phase: Floats,
        place: Floats,
        classes: Floats | None = None,
    ) -> CameraSweep:
        """Uploads the weights.

        Args:
            device, box, real, packets: those of the sweeper.
            program: sweep.cl with CAMERA_SWEEP.
            medium: the original medium, without delta-M.
            phase: `ScatteringTable.by_half_sine` of each class of droplet size; one number without
                PHASE_STEPS.
            classes: (K, P) shares of these classes, with PHASE_CLASSES.
        """
        seen: dict[bool, dict[str, Any]] = {turned: {} for turned in packets}
        views: dict[str, Floats] = {}
        if "VIEW_TRANSMISSION" in program.defines:
            views = {"seen": medium.depth, "inverse_mean": 1.0 / mean_transmission(medium.depth)}
        if "BLURRED_BOUNDARY" in program.defines:
            views["whole_depth"] = medium.depth
        for name, values in views.items():
            dense = turned_too(medium.dense(box, values.astype(real)))
            for turned, some in packets.items():
                seen[turned][name] = upload(device, "optical depth", some.packed(dense[turned]))
        if classes is not None:
            each = [turned_too(medium.dense(box, one.astype(real))) for one in classes[1:]]
            for turned, some in packets.items():
                packed = np.stack([some.packed(one[turned]) for one in each], axis=1)
                seen[turned]["class_shares"] = upload(device, "size classes", packed)
        return cls(
            device=device,
            real=real,
            program=program,
            phase=upload(device, "phase function", phase.astype(real)),
            place=place,
            shares={
                turned: zeros(device, "shares", some.cells, real)
                for turned, some in packets.items()
            },
            seen=seen,
        )
