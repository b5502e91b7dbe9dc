"""Measured cost of a trace, and that of a larger one which is expected from it.

Sweeps take time in proportion to cells and ordinates, rays of the image to the pixels that see the
medium and to the cells along a ray.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from cldit.gpu.device import Device
from cldit.transport.result import Trace, TraceSettings


@dataclass(frozen=True)
class TraceCost:
    """Measured cost of a trace: swept cells, ordinates, pixels, core seconds of sweeps and rays."""

    cells: int
    ordinates: int
    pixels: int
    sweeps_s: float
    rays_s: float

    @classmethod
    def measured(
        cls,
        device: Device,
        cells: int,
        settings: TraceSettings,
        work: Callable[[], Trace],
    ) -> "tuple[Trace, TraceCost]":
        """Traces and measures: core seconds of this process, on a GPU those of the clock."""
        clock = time.process_time if device.is_cpu else time.perf_counter
        start = clock()
        trace = work()
        spent_s = clock() - start
        total = sum(trace.seconds.values())
        spent_s /= max(total, 1e-9)  # core seconds for a second; compilation is paid once
        swept = trace.seconds.get("scattering", 0.0)
        seen = trace.seconds.get("image", 0.0) + trace.seconds.get("gather", 0.0)
        pixels = trace.weights.background.size
        ordinates = settings.final_directions
        return trace, cls(cells, ordinates, pixels, swept * spent_s, seen * spent_s)

    def scaled_s(self, cells: int, ordinates: int, pixels: int, wavelengths: int) -> float:
        """Core seconds of an image of `wavelengths` with so many ordinates in all."""
        growth = cells / max(self.cells, 1)  # an empty medium has none
        return float(
            self.sweeps_s * growth * ordinates / self.ordinates
            + self.rays_s * growth ** (1 / 3) * pixels / self.pixels * wavelengths
        )
