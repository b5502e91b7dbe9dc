"""A rig whose instruments reply at once: only the computer takes time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from cldit.rig.clock import Clock, StopCheck
from cldit.rig.load import DriverChoice, Rig, RigFile, Setup
from cldit.rig.protocols import (
    Burst,
    Capabilities,
    DeviceInfo,
    Frame,
    Limits,
    Roi,
    Safety,
    Settings,
    Stability,
    TriggerInfo,
    TriggerMode,
)

KELVIN = 440.0
_CALIBRATION = {
    "filter_um": [3.3, 3.5],
    "counts_per_radiance": 1e-18,
    "offset_counts": 1000.0,
    "electrons_per_count": 430.0,
    "read_noise_electrons": 200.0,
    "saturation_counts": 16383,
}


class _Device:
    """Instrument that replies at once."""

    kind = "device"

    def connect(self, timeout_s: float = 10.0) -> None: ...

    def close(self) -> None: ...

    def make_safe(self) -> Safety:
        return Safety(connected=True, did="nothing: it has no parts")

    def identify(self) -> DeviceInfo:
        return DeviceInfo(self.kind, "cldit", f"bench {self.kind}", simulated=True)

    def read_configuration(self) -> dict[str, Any]:
        return {"calibration": _CALIBRATION}


class _Camera(_Device):
    """Camera with noise on `sensor` pixels; frames are available at once."""

    kind = "camera"

    def __init__(self, sensor: tuple[int, int]) -> None:
        self._sensor = sensor
        columns, rows = sensor
        noise = np.random.default_rng(1).integers(0, 8192, (rows, columns))
        self._base = noise.astype(np.uint16)
        self._id = -1

    @property
    def capabilities(self) -> Capabilities:
        modes = frozenset({TriggerMode.SOFTWARE, TriggerMode.EXTERNAL_EDGE})
        return Capabilities(modes, (1e-7, 1.0), 0.0, 16383, self._sensor, ("Mono16",))

    def wait_ready(self, timeout_s: float) -> None: ...

    def configure(
        self, integration_time_s: float, roi: Roi | None = None, pixel_format: str | None = None
    ) -> Settings:
        return Settings(integration_time_s, Roi(0, 0, *self._sensor), "Mono16")

    def prepare(self, trigger: TriggerInfo) -> None: ...

    def arm(self) -> None: ...

    def flush(self) -> int:
        return 0

    def software_trigger(self) -> None: ...

    def read_frames(self, n: int, timeout_s: float) -> Iterator[Frame]:
        for _ in range(n):
            self._id += 1
            data = self._base + np.uint16(self._id % 8000)
            now_ns = time.time_ns()
            yield Frame(data, self._id, now_ns, now_ns)

    def disarm(self) -> None: ...

    def statistics(self) -> dict[str, int]:
        return {"delivered": self._id + 1, "missed": 0, "flushed": 0}


class _Background(_Device):
    kind = "background"
    limits = Limits(273.0, 1000.0)

    def set_setpoint(self, temperature_K: float) -> float:
        return temperature_K

    def read_temperature(self) -> float:
        return KELVIN

    def is_stable(self) -> bool | None:
        return True

    def wait_stable(
        self,
        temperature_K: float,
        stability: Stability,
        should_stop: StopCheck | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> float:
        return temperature_K


class _Trigger(_Device):
    kind = "trigger"

    def configure(self, burst: Burst) -> Burst:
        return burst

    def fire(self) -> None: ...

    def wait_done(self, timeout_s: float) -> None: ...

    def inhibit(self) -> None: ...

    def abort(self) -> None: ...


def prompt_rig(sensor: tuple[int, int]) -> Rig:
    """Rig with a camera of `sensor` columns and rows, and a background at `KELVIN`."""
    choice = DriverChoice(driver="bench")
    setup = Setup(pixel_m=(1e-4, 1e-4))
    file = RigFile(name="bench", setup=setup, camera=choice, background=choice, trigger=choice)
    return Rig(_Camera(sensor), _Background(), _Trigger(), Clock(), file)
