"""Quadrature of discrete ordinates on the device, with its sweep schedules."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.sweep_arrays import Real
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule, sweep_schedules


@dataclass(frozen=True)
class DeviceOrdinates:
    """Quadrature and its arguments of kernels/sweep.cl.

    sweep_schedules: schedules with their kernel arguments, and those for SPATIAL_MOMENTS.
    """

    directions: Ordinates
    sweep_schedules: tuple[tuple[SweepSchedule, dict[str, Any], dict[str, Any]], ...]

    @classmethod
    def of(
        cls,
        device: Device,
        box: SweptBox,
        directions: Ordinates,
        starts: Floats,
        *,
        batch: int,
        edge: int | None,
        real: Real,
    ) -> "DeviceOrdinates":
        """Uploads a quadrature; arguments as in `sweep_schedules`. `edge` None: without tiles."""
        ready = []
        tile_edge = max(box.shape) if edge is None else edge
        for schedule in sweep_schedules(box, directions, starts, batch=batch, edge=tile_edge):
            nothing = np.zeros((len(schedule), 1))
            margin = schedule.layout.size[2] + 1  # cells by which rays shift
            origin = np.where([schedule.rightwards, schedule.upwards], margin, 1)
            tables = {
                **({} if edge is None else {"tiles": schedule.tiles}),
                "begins_at": schedule.begins,
                "sides": schedule.exit_faces,
                "shifts": schedule.shifts,
                "parts": np.column_stack([schedule.midpoint, schedule.layer_share]).astype(real),
                "backs": np.column_stack([schedule.back, nothing]).astype(real),
                "beams": np.column_stack([schedule.path_per_layer, schedule.weight]).astype(real),
                "origins": np.column_stack([*origin, schedule.number, nothing]).astype(np.int32),
            }
            slope = schedule.basis_scale * schedule.back
            spatial = {
                "basis": np.column_stack([schedule.basis, schedule.layer_share]).astype(real),
                "basis_slopes": np.column_stack([slope, nothing]).astype(real),
            }
            ready.append(
                (
                    schedule,
                    {name: upload(device, "schedule", table) for name, table in tables.items()},
                    {name: upload(device, "schedule", table) for name, table in spatial.items()},
                )
            )
        return cls(directions, tuple(ready))
