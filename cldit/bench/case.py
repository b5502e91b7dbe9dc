"""Measurement of a scene: its changes, and the cost of work on a device."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cldit.errors import ClditError
from cldit.gpu.device import Device
from cldit.scene import Scene

Say = Callable[[str], None]


class BenchError(ClditError):
    """Measurement that cannot be made."""


@dataclass(frozen=True)
class Cost:
    """Cost of a trace without compilation.

    core_s: CPU seconds of this process, all cores; wall seconds on a GPU.
    """

    core_s: float
    wall_s: float


def clocked(device: Device, work: Callable[[], Any]) -> tuple[Any, Cost]:
    """Result of `work` and its cost on `device`."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    device.queue.finish()
    wall_s = time.perf_counter() - wall
    core_s = time.process_time() - cpu
    return result, Cost(core_s if device.is_cpu else wall_s, wall_s)


def changed(scene: Scene, **sections: dict[str, Any]) -> Scene:
    """Scene with keys of some sections replaced, validated again."""
    paths = {
        f"{name}.{key}": value for name, keys in sections.items() for key, value in keys.items()
    }
    return scene.with_(**paths)
