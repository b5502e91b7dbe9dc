"""A set of directions on the device, ready to be swept along as often as is wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.transport.cells import Box
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.sweep_arrays import Real
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule, sweep_schedules


@dataclass(frozen=True)
class DeviceOrdinates:
    """sweep_schedules: each with the arguments that kernels/sweep.cl takes of it; and those that it
    takes with SPATIAL_MOMENTS besides."""

    directions: Ordinates
    sweep_schedules: tuple[tuple[SweepSchedule, dict[str, Any], dict[str, Any]], ...]

    @classmethod
    def of(
        cls,
        device: Device,
        box: Box,
        directions: Ordinates,
        starts: NDArray[np.float64],
        *,
        together: int,
        edge: int,
        real: Real,
    ) -> DeviceOrdinates:
        """starts: (len(directions), 2) in 0..1, where rays cross the cells of the first layer;
        together: so many directions at most go through the box at once, by tiles of this edge."""
        ready = []
        for schedule in sweep_schedules(box, directions, starts, together=together, edge=edge):
            nothing = np.zeros((len(schedule), 1))
            most = schedule.layout.size[2] + 1  # that rays move
            origin = np.where([schedule.rightwards, schedule.upwards], most, 1)
            tables = {
                "tiles": schedule.tiles,
                "begins_at": schedule.begins,
                "sides": schedule.faces,
                "shifts": schedule.shifts,
                "parts": np.column_stack([schedule.middle, schedule.part]).astype(real),
                "backs": np.column_stack([schedule.back, nothing]).astype(real),
                "beams": np.column_stack([schedule.stretch, schedule.weight]).astype(real),
                "origins": np.column_stack([*origin, schedule.number, nothing]).astype(np.int32),
            }
            across = {
                "basis": np.column_stack([schedule.basis, schedule.part]).astype(real),
                "basis_slopes": np.column_stack([schedule.gain * schedule.back, nothing]).astype(
                    real
                ),
            }
            ready.append(
                (
                    schedule,
                    {name: upload(device, "routes", table) for name, table in tables.items()},
                    {name: upload(device, "routes", table) for name, table in across.items()},
                )
            )
        return cls(directions, tuple(ready))
