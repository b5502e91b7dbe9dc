"""A set of directions on the device, ready to be swept along as often as is wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.transport.cells import Box
from cldit.transport.discrete_ordinates.quadrature import Directions
from cldit.transport.discrete_ordinates.sweep_arrays import Real
from cldit.transport.discrete_ordinates.sweep_schedule import Route, routes


@dataclass(frozen=True)
class Rays:
    """routes: with what kernels/sweep.cl takes of each, from `tiles` to `origins`, and then with
    ACROSS."""

    directions: Directions
    routes: tuple[tuple[Route, list[Any], list[Any]], ...]

    @classmethod
    def of(
        cls,
        device: Device,
        box: Box,
        directions: Directions,
        starts: NDArray[np.float64],
        *,
        together: int,
        edge: int,
        real: Real,
    ) -> Rays:
        """starts: (len(directions), 2) in 0..1, where rays cross the cells of the first layer;
        together: so many directions at most go through the box at once, by tiles of this edge."""
        ready = []
        for route in routes(box, directions, starts, together=together, edge=edge):
            nothing = np.zeros((len(route), 1))
            most = route.layout.size[2] + 1  # that rays move
            origin = np.where([route.rightwards, route.upwards], most, 1)
            tables = [
                route.tiles,
                route.begins,
                route.faces,
                route.shifts,
                np.column_stack([route.middle, route.part]).astype(real),
                np.column_stack([route.back, nothing]).astype(real),
                np.column_stack([route.stretch, route.weight]).astype(real),
                np.column_stack([*origin, route.number, nothing]).astype(np.int32),
            ]
            across = [
                np.column_stack([route.lever, route.part]).astype(real),
                np.column_stack([route.gain * route.back, nothing]).astype(real),
            ]
            ready.append(
                (
                    route,
                    [upload(device, "routes", table) for table in tables],
                    [upload(device, "routes", table) for table in across],
                )
            )
        return cls(directions, tuple(ready))
