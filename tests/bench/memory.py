"""Peak memory of runs and time of compilation, each case in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyopencl as cl

from cldit.bench.case import BenchError, Say, changed
from cldit.bench.report import Part, Table
from cldit.gpu.device import Device, open_device
from cldit.io.files import make_folder, write_text
from cldit.run import default_cache, simulate
from cldit.scene import Scene, dump_scene, load_scene
from tests.bench.page import UNLISTED, write_measured

_WHOLE = "the scene as it is, with rig, evaluation of the shots and report"
_CASES: tuple[tuple[str, dict[str, Any] | None], ...] = (
    ("nothing but the imports and the device", None),
    ("source, isotropic", {"method": "source", "phase": "isotropic"}),
    ("source, mie", {"method": "source", "phase": "mie"}),
    ("path, 128 samples", {"method": "path", "phase": "isotropic", "max_samples": 128}),
    (_WHOLE, {}),
)


@dataclass(frozen=True)
class Peak:
    """resident_bytes: largest memory of the process; buffer_bytes: of its device buffers, which are
    part of it on a CPU. compile_s: wall seconds of building kernels."""

    resident_bytes: int
    buffer_bytes: int
    compile_s: float


def memory(scene: Scene, device: Device, *, say: Say) -> Part:
    """Measures whole runs, each with empty and with filled kernel caches."""
    mie = scene.spray.model not in ("none", "grid")
    lines, data = [], []
    for label, transport in _CASES:
        if transport is not None and transport.get("phase") == "mie" and not mie:
            continue
        chosen = None if transport is None else changed(scene, transport=transport)
        with tempfile.TemporaryDirectory() as folder:
            fresh, cached = (
                _apart(chosen, device, Path(folder), whole=label == _WHOLE) for _ in range(2)
            )
        say(f"{label}: {fresh.resident_bytes / 1e9:.2f} GB, built in {fresh.compile_s:.2f} s")
        lines.append(
            (
                label,
                f"{fresh.resident_bytes / 1e9:.2f}",
                f"{fresh.buffer_bytes / 1e9:.3f}",
                "-" if chosen is None else f"{fresh.compile_s:.2f}",
                "-" if chosen is None else f"{cached.compile_s:.2f}",
            )
        )
        data.append({"case": label, "fresh": vars(fresh), "cached": vars(cached)})
    return Part(
        name="memory",
        title=f"Memory and compilation: {scene.name}",
        tables=(
            Table.of(
                ("run", "peak, GB", "device buffers, GB", "compiled, s", "from cache, s"), lines
            ),
        ),
        data=data,
        text=(
            "Peak resident memory (VmHWM) of a process that makes the whole run: spray, optics, "
            "octree, trace, evaluation. The last row is that of `cldit run`. On a CPU it includes "
            "the device buffers.",
        ),
    )


def _apart(scene: Scene | None, device: Device, folder: Path, *, whole: bool) -> Peak:
    """Runs in a process of its own with kernel caches in `folder`; whole: the experiment."""
    file = folder / "scene.yaml"
    if scene is not None:
        write_text(file, dump_scene(scene))
    caches = {"POCL_CACHE_DIR": str(folder / "pocl"), "XDG_CACHE_HOME": str(folder / "cache")}
    make_folder(folder / "pocl")
    done = subprocess.run(
        [sys.executable, "-m", "tests.bench.memory", device.info.index, str(default_cache())]
        + ([] if scene is None else [str(file)])
        + ([tempfile.mkdtemp(dir=folder)] if whole else []),
        env={**os.environ, **caches},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise BenchError(f"memory: the measuring process failed:\n{done.stderr[-2000:]}")
    return Peak(**json.loads(done.stdout.splitlines()[-1]))


def _counting(counts: dict[str, int]) -> type[cl.Buffer]:
    """Class of buffers that count their bytes: `now` and at `most`."""

    class Counted(cl.Buffer):  # type: ignore[misc, unused-ignore]
        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            counts["now"] += self.size
            counts["most"] = max(counts["most"], counts["now"])

        def __del__(self) -> None:
            counts["now"] -= self.size

    return Counted


def _status() -> Mapping[str, str]:
    text = Path("/proc/self/status").read_text(encoding="utf-8")
    return dict(line.split(":", 1) for line in text.splitlines())


def _measure(arguments: list[str]) -> Peak:
    """Measures this process, which does nothing else; all of its buffers are counted."""
    index, cache, *files = arguments
    counts = {"now": 0, "most": 0}
    cl.Buffer = _counting(counts)  # type: ignore[misc]
    device = open_device(index)
    compile_s = 0.0
    if files:
        run = simulate(load_scene(files[0]), *files[1:], device=device, cache=Path(cache))
        if files[1:]:  # goes on from the run that is stored there
            from cldit.api.experiment import run_experiment  # would count in the other rows

            run_experiment(load_scene(files[0]), files[1], device=device)
        compile_s = next(stage.seconds for stage in run.info.stages if stage.name == "compile")
    resident = int(_status()["VmHWM"].split()[0]) * 1024
    return Peak(resident, counts["most"], compile_s)


def main() -> None:
    """Peak memory of runs and of their parts, as a page."""
    write_measured(lambda given: memory(given.scene, given.device, say=given.say), folder=UNLISTED)


if __name__ == "__main__":  # the measured process
    print(json.dumps(vars(_measure(sys.argv[1:]))))
