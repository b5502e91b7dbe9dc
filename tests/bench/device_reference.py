"""Reference of `cldit devices --check`: the sums of what kernels write, on this device.

`python -m tests.bench device_reference` writes cldit/run/device_check.json, after the tests of the
kernels have passed on this device. The code for CPUs and that for GPUs run here, with double
precision and without; results of the same problem have to agree to a tenth of the tolerance.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from cldit.gpu.device import Device, open_device
from cldit.run import device_check

PATH = Path(device_check.__file__).with_suffix(".json")


def variants(device: Device) -> list[Device]:
    """The device as a CPU and as a GPU, with double precision and without."""
    return [
        replace(device, info=replace(device.info, kind=kind, float64=float64))
        for kind in ("cpu", "gpu")
        for float64 in (True, False)
    ]


def merged(device: Device) -> dict[str, dict[str, list[list[float]]]]:
    """Sums by problem; those that differ between CPUs and GPUs are by the number of lanes."""
    out: dict[str, dict[str, Any]] = {}
    for one in variants(device):
        lanes = device_check.lanes(one)
        for name, rounding, problem in device_check.problems(one):
            launches = device_check.Launches(rounding, None)
            device_check.solve(problem, one, launches)
            known = out.setdefault(name, {})
            for key, planes in launches.sums.items():
                before = known.setdefault(key, planes)
                pairs = zip(planes, before, strict=True)
                if any(abs(total - old) > 2e-6 * size for (total, size), (old, _) in pairs):
                    out.setdefault(f"{name}, {lanes}", {})[key] = planes
    rounded = {
        name: {
            key: [[float(f"{one:.9g}") for one in pair] for pair in planes]
            for key, planes in sums.items()
        }
        for name, sums in out.items()
    }
    return rounded


def main() -> None:
    """Writes the reference."""
    made = merged(open_device())
    lines = [
        f" {json.dumps(name)}: {{\n"
        + ",\n".join(f"  {json.dumps(key)}: {json.dumps(planes)}" for key, planes in sums.items())
        + "\n }"
        for name, sums in made.items()
    ]
    PATH.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
