"""Quadrature of discrete ordinates on the device, with its sweep schedules."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates.cell_packets import Real
from cldit.transport.discrete_ordinates.quadrature import Ordinates
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
        tile_edge = max(box.shape) if edge is None else edge
        schedules = sweep_schedules(box, directions, starts, batch=batch, edge=tile_edge)

        def uploaded(tables: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
            return {
                name: upload(
                    device, "schedule", table if table.dtype == np.int32 else table.astype(real)
                )
                for name, table in tables.items()
                if name != "tiles" or edge is not None
            }

        return cls(
            directions,
            tuple(
                (schedule, uploaded(schedule.tables), uploaded(schedule.spatial))
                for schedule in schedules
            ),
        )
