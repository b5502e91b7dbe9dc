"""Cost of `cldit acquire --live`: time between shots with it over that without.

    python -m tests.bench live_timing [PAIRS]

The simulated rig takes full frames (640 x 512) in a terminal of its own (a pty), with and without
`--live` in turns (ABBA), so that other work on the computer affects both. The time of a shot is
that of its file, as the clock of the rig is simulated. Two rigs: one without any waiting, which an
observing process slows most, and one with 0.2 s between shots, faster than an injector is fired.
"""

from __future__ import annotations

import os
import pty
import statistics
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cldit.acquisition import plan_from_scene
from cldit.rig.simulated import simulated_rig_data
from cldit.scene import Scene, dump_scene, parse_scene
from tests.conftest import tiny_weights

WARM_s = 5.0
SETTINGS = (
    {"factor": None, "pause": 0.0, "shots": 250},
    {"factor": 100.0, "pause": 20.0, "shots": 70},
)


def scene() -> Scene:
    return parse_scene(
        {
            "name": "full frames",
            "spray": {"model": "none"},
            "camera": {"pixels": [160, 128], "field_m": [0.16, 0.128],
                       "sensor": {"pixels": [640, 512]}},
            "background": {"temperatures_K": [440.0], "radius_m": 0.05},
            "walls": {"temperature_K": 420.0},
            "plan": {"shots": 3, "references": 2},
        }
    )  # fmt: skip


def files(folder: Path, settings: dict[str, Any]) -> None:
    """Rig, plan and traced run in `folder`."""
    wanted, shots = scene(), settings["shots"]
    run = folder / "run"
    run.mkdir(parents=True)
    (run / "scene.yaml").write_text(dump_scene(wanted), encoding="utf-8")
    for name, depth in (("weights", 2.0), ("weights_reference", 0.0)):
        tiny_weights(wanted, depth=depth).save(run / name, pixel_m=(1e-3, 1e-3))
    rig = simulated_rig_data(wanted, run, real_time_factor=settings["factor"])
    plan = plan_from_scene(wanted).model_copy(
        update={"shots": shots // 2, "references": shots - shots // 2, "pause_s": settings["pause"]}
    )
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig), encoding="utf-8")
    (folder / "plan.yaml").write_text(plan.dump(), encoding="utf-8")


def intervals_s(folder: Path, out: str, *, live: bool) -> list[float]:
    """Between the shots of one recording, without those while processes start: with a real black
    body, that is over long before the first shot."""
    arguments = ["acquire", *(str(folder / name) for name in ("rig.yaml", "plan.yaml"))]
    arguments += ["--out", str(folder / out), *(["--live"] if live else [])]
    os.environ.pop("DISPLAY", None)

    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [sys.executable, "-m", "cldit", *arguments])
    with suppress(OSError):  # of a pty whose other end is closed
        while os.read(terminal, 65536):
            pass
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    os.close(terminal)
    assert status == 0, f"cldit {' '.join(arguments)} ended with {status}"
    times = sorted(path.stat().st_mtime_ns for path in (folder / out / "shots").glob("*.tif"))
    since_s = (np.array(times[1:]) - times[0]) / 1e9
    return [float(each) for each in (np.diff(times) / 1e9)[since_s > WARM_s]]


def main(pairs: int) -> None:
    for settings in (
        {"factor": None, "pause": 0.0, "shots": 250},
        {"factor": 100.0, "pause": 20.0, "shots": 70},
    ):
        found: dict[bool, list[list[float]]] = {False: [], True: []}
        with tempfile.TemporaryDirectory(prefix="cldit-live-") as place:
            files(Path(place), settings)
            for number in range(2 * pairs):
                live = number % 4 in (1, 2)
                found[live].append(intervals_s(Path(place), f"a{number}", live=live))
        ratios = [
            statistics.median(with_it) / statistics.median(without)
            for with_it, without in zip(found[True], found[False], strict=True)
        ]
        for live, runs in found.items():
            every = [each for run in runs for each in run]
            low, high = (1e3 * float(np.percentile(every, q)) for q in (50, 99))
            sys.stdout.write(
                f"\n{settings} live {live}: median {low:.1f} ms, percentile 99 {high:.1f} ms\n"
            )
        each = ", ".join(f"{ratio:.3f}" for ratio in ratios)
        sys.stdout.write(f"ratio of medians, pair by pair: {each}\n")


if __name__ == "__main__":
    main(int([*sys.argv[1:], "2"][0]))
