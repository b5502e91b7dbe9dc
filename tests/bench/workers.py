"""Efficiency of workers on this machine: scenes a second on all cores, over those on one core.

Each sweep traces as many scenes for each worker. Scenes before every worker has finished one are
not counted: they include imports, tables and kernels. CPU seconds are those of all workers.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cldit.bench.case import changed
from cldit.bench.report import Part, Table, number
from cldit.scene import Scene
from cldit.study.grid import Grid
from cldit.study.sweep import Progress, run_sweep
from tests.bench.page import Given, write_measured

BAR = 0.85
_SMALL: dict[str, dict[str, Any]] = {
    "camera": {"pixels": [48, 48], "rays_per_pixel": 1},
    "transport": {"accuracy_K": 2.0, "audit": False},
    "domain": {"leaf_edge_m": 1.2e-3},
}


@dataclass(frozen=True)
class Rate:
    """Scenes a second of so many workers, each with one core, and CPU seconds of a scene."""

    workers: int
    scenes_s: float
    core_s: float


def rate(scene: Scene, workers: int, scenes: int) -> Rate:
    """Sweeps `scenes` seeds a worker on as many cores as there are workers."""
    cores = sorted(os.sched_getaffinity(0))
    grid = Grid.parse(f"transport.seed=1:{workers * scenes}:1")
    done_s: list[float] = []

    def watch(_: Progress) -> None:
        done_s.append(time.perf_counter())

    os.sched_setaffinity(0, cores[:workers])
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        with tempfile.TemporaryDirectory() as folder:
            run_sweep(scene, grid, Path(folder) / "sweep", workers=workers, watch=watch)
    finally:
        os.sched_setaffinity(0, cores)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    counted = len(done_s) - workers
    return Rate(workers, counted / (done_s[-1] - done_s[workers - 1]), spent_s / (workers * scenes))


def measured(given: Given) -> Part:
    """Rates of one worker, and of one for each core."""
    scene = changed(given.scene, **_SMALL)
    most, scenes = len(os.sched_getaffinity(0)), given.options.scenes
    rate(scene, 1, 2)  # tables and kernels are made
    one, all_ = (rate(scene, workers, scenes) for workers in (1, most))
    efficiency = all_.scenes_s / one.scenes_s / most
    rows = [
        (str(each.workers), number(each.scenes_s, 3), number(each.core_s, 3))
        for each in (one, all_)
    ]
    text = (
        f"Efficiency {efficiency:.2f} of {most} workers (bar: {BAR}); CPU seconds of a scene: "
        f"{one.core_s / all_.core_s:.2f} of those on all cores."
    )
    return Part(
        name="workers",
        title="Efficiency of workers on one machine",
        tables=(Table.of(("workers", "scenes a second", "core-s a scene"), rows),),
        data=[vars(each) for each in (one, all_)],
        text=(text,),
    )


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", type=int, default=8, help="of each worker (default: 8)")


def main() -> None:
    """Measures and writes the page."""
    write_measured(measured, _options)
