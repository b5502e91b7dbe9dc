"""Cost of a coarse trace, from which that of the image is expected.

Sweeps take time in proportion to cells and ordinates, rays of the image to pixels and to the cells
along a ray.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from cldit.gpu.device import Device
from cldit.transport.trace import Trace, TraceSettings


@dataclass(frozen=True)
class CoarseCost:
    """Measured cost of one coarse trace: swept cells, ordinates, pixels, and core seconds of the
    sweeps and of the rest."""

    cells: int
    ordinates: int
    pixels: int
    sweeps_s: float
    rays_s: float

    @classmethod
    def measured(
        cls, device: Device, cells: int, settings: TraceSettings, work: Callable[[], Trace]
    ) -> tuple[Trace, CoarseCost]:
        """Traces and measures: core seconds of this process, on a GPU those of the clock."""
        clock = time.process_time if device.is_cpu else time.perf_counter
        start = clock()
        found = work()
        spent_s = clock() - start
        whole = sum(found.seconds.values())
        swept = found.seconds.get("scattering", 0.0) / whole if whole > 0.0 else 0.0
        pixels = found.weights.background.size
        ordinates = settings.final_directions
        return found, cls(cells, ordinates, pixels, swept * spent_s, (1.0 - swept) * spent_s)

    def scaled_s(self, cells: int, ordinates: int, pixels: int, wavelengths: int) -> float:
        """Core seconds of an image of `wavelengths` with so many ordinates in all."""
        more = cells / max(self.cells, 1)  # an empty medium has none
        return float(
            self.sweeps_s * more * ordinates / self.ordinates
            + self.rays_s * more ** (1 / 3) * pixels / self.pixels * wavelengths
        )
