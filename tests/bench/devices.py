"""The same scenes on each OpenCL device here: wall time, and how far their images are apart."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from cldit.bench.case import changed
from cldit.bench.report import Part, number
from cldit.gpu.device import DeviceInfo, list_devices, open_device
from cldit.run import Run, simulate
from cldit.scene import Scene, load_scene
from cldit.show.page import Table
from tests.bench.page import Given, write_measured

_TRACED = ("scattering", "image", "audit")  # stages


def _scene(name: str, **sections: dict[str, object]) -> Callable[[], Scene]:
    return lambda: changed(load_scene(name), **sections)


def _pixels(count: int) -> dict[str, object]:
    return {"pixels": [count] * 2}


SCENES = {
    "gdi-cone": _scene("gdi-cone"),
    "gdi-cone, 100 x 100": _scene("gdi-cone", camera=_pixels(100)),
    "gdi-cone, 0.3 K": _scene("gdi-cone", transport={"accuracy_K": 0.3}),
    "gdi-cone, path tracing": _scene("gdi-cone", transport={"method": "path"}),
    "droplets-only": _scene("droplets-only"),
    "methane-jet": _scene("methane-jet"),
}


def _timed(scene: Scene, given: Given, device: DeviceInfo) -> tuple[Run, float]:
    """A run whose programs and tables are there, and its wall time."""
    opened = open_device(device.index)
    simulate(scene, device=opened, cache=given.cache)
    start = time.perf_counter()
    run = simulate(scene, device=opened, cache=given.cache)
    return run, time.perf_counter() - start


def measured(given: Given) -> Part:
    """Times a second run of each scene on each device, and compares its T_app with the first's."""
    rows = []
    for name in given.options.case or SCENES:
        scene, first = SCENES[name](), None
        for device in list_devices():
            run, wall_s = _timed(scene, given, device)
            image = run.maps.apparent_temperature_K.astype(float)
            first = image if first is None else first
            apart = np.abs(image - first)[np.isfinite(image - first)]
            took = [one.seconds for one in run.info.stages if one.name in _TRACED]
            stated = "" if run.errors is None else run.errors.text
            rows.append(
                (
                    name,
                    device.name,
                    number(wall_s),
                    number(sum(took)),
                    stated,
                    number(float(np.sqrt(np.mean(apart**2)))) if apart.size else "",
                    number(float(apart.max())) if apart.size else "",
                )
            )
            stages = {one.name: round(one.seconds, 3) for one in run.info.stages}
            given.say(f"{rows[-1]}\n    {stages}")
    head = ("scene", "device", "wall, s", "of it traced, s", "error", "RMS, K", "largest, K")
    return Part("devices", "The same scenes on each device", (Table(head, rows),), rows)


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--case", action="append", choices=SCENES, help="only these scenes")


def main() -> None:
    """Writes docs/benchmarks/devices.md."""
    write_measured(measured, _options)
