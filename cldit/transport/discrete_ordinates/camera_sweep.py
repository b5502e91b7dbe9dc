"""Weights for scattering to the camera in the final sweeps (stage 3 of `trace_source`)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.gpu.buffers import upload, zeros
from cldit.gpu.program import Program
from cldit.transport.cells import OpticalCells, mean_transmission
from cldit.transport.discrete_ordinates.axis_order import AxisOrder
from cldit.transport.discrete_ordinates.swept_boxes import SweptBoxes


@dataclass(frozen=True)
class CameraSweep:
    """Sweep program that weights ordinates by the scattering to the camera.

    phase: phase function in equal steps of the sine of half the angle.
    place: (4,) position of the camera, in cells from the box's lower corner, and 1 for a pinhole, 0
        for parallel rays.
    shares: sums of weights in every cell, in packets of either order of axes.
    seen: with VIEW_TRANSMISSION, optical depths to the camera and inverse mean transmissions; with
        BLURRED_BOUNDARY, optical depths; with PHASE_CLASSES, shares of the droplet size classes.
    """

    program: Program
    phase: Any
    place: NDArray[Any]
    shares: dict[bool, Any]
    seen: dict[bool, dict[str, Any]]

    @classmethod
    def of(
        cls,
        boxes: SweptBoxes,
        program: Program,
        medium: OpticalCells,
        *,
        phase: Floats,
        place: Floats,
        classes: Floats | None = None,
    ) -> "CameraSweep":
        """Uploads the weights.

        Args:
            program: sweep.cl with CAMERA_SWEEP.
            medium: the original medium, without delta-M.
            phase: `ScatteringTable.by_half_sine` of each class of droplet size; one number without
                PHASE_STEPS.
            place: (4,) likewise, in cells of the cube.
            classes: (K, P) shares of these classes, with PHASE_CLASSES.
        """
        device, box, packets, real = boxes.device, boxes.box, boxes.packets, boxes.real
        seen: dict[bool, dict[str, Any]] = {turned: {} for turned in packets}
        views: dict[str, Floats] = {}
        if "VIEW_TRANSMISSION" in program.defines:
            views = {"seen": medium.depth, "inverse_mean": 1.0 / mean_transmission(medium.depth)}
        if "BLURRED_BOUNDARY" in program.defines:
            views["whole_depth"] = medium.depth
        for name, values in views.items():
            dense = medium.dense(box, values.astype(real))
            for turned, cell_packets in packets.items():
                seen[turned][name] = upload(device, "optical depth", cell_packets.packed(dense))
        if classes is not None:
            shares = [medium.dense(box, class_share.astype(real)) for class_share in classes[1:]]
            for turned, cell_packets in packets.items():
                packed = np.stack([cell_packets.packed(share) for share in shares], axis=1)
                seen[turned]["class_shares"] = upload(device, "size classes", packed)
        return cls(
            program=program,
            phase=upload(device, "phase function", phase.astype(real)),
            place=(place - [*box.low, 0.0]).astype(real),
            shares={
                turned: zeros(device, "shares", cell_packets.cells, boxes.sum_type)
                for turned, cell_packets in packets.items()
            },
            seen=seen,
        )

    def arguments(self, layout: AxisOrder) -> dict[str, Any]:
        """Kernel arguments of the sweep for CAMERA_SWEEP."""
        return {
            "shares": self.shares[layout.turned],
            "phase": self.phase,
            "camera": self.place,
            **self.seen[layout.turned],
        }
