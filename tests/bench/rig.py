"""Full frames per second that the runner saves on a disk, every guarantee kept.

    python -m tests.bench rig --folder FOLDER

The limit of the disk is measured with it: how often a bare loop can append a line to a file and
sync it, which a shot needs before its trigger and, with its images, after it.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import platform
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from cldit.acquisition.plan import Plan
from cldit.acquisition.progress import Progress
from cldit.acquisition.record import open_acquisition
from cldit.acquisition.runner import acquire
from cldit.rig.load import Rig
from tests.prompt_rig import KELVIN, prompt_rig

FRAMES_PER_SHOT = (1, 4, 16)
_FLOOR_SYNCS = 60


@dataclass(frozen=True)
class BenchResult:
    """For each repetition: frames saved per second, and syncs per second of the bare loop right
    before and after it. cpu_s: of this process for one frame. lost: frames taken and not found
    afterwards, in all repetitions.
    """

    frames_per_shot: int
    frames_per_s: tuple[float, ...]
    syncs_per_s: tuple[float, ...]
    cpu_s: tuple[float, ...]
    lost: int
    sensor: tuple[int, int]

    @property
    def shots_per_sync(self) -> float:
        """Median over the repetitions; 0.5: a shot costs two syncs and nothing else."""
        pairs = zip(self.frames_per_s, self.syncs_per_s, strict=True)
        return statistics.median(rate / self.frames_per_shot / syncs for rate, syncs in pairs)


def bench_rig(
    folder: Path | None = None,
    *,
    frames: int = 300,
    frames_per_shot: int = 1,
    repeats: int = 1,
    sensor: tuple[int, int] = (640, 512),
) -> BenchResult:
    """Runs a plan of `frames` images at one background through the real runner, `repeats` times."""
    plan = Plan.model_validate(
        {
            "backgrounds_K": [KELVIN],
            "shots": max(frames // frames_per_shot, 1),
            "references": 1,
            "frames": frames_per_shot,
            "pause_s": 0.0,
            "stability": {"hold_s": 0.0, "settle_s": 0.0},
        }
    )
    rates, syncs, cpu_s, lost = [], [], [], 0
    for _ in range(repeats):
        rig = prompt_rig(sensor)
        with tempfile.TemporaryDirectory(dir=folder, prefix="cldit-bench-") as place:
            before = _syncs_per_s(Path(place))
            rate, used_s, missing = _measure(rig, plan, Path(place) / "a")
            rates.append(rate)
            cpu_s.append(used_s)
            lost += missing
            syncs.append((before + _syncs_per_s(Path(place))) / 2.0)
    return BenchResult(frames_per_shot, tuple(rates), tuple(syncs), tuple(cpu_s), lost, sensor)


def _measure(rig: Rig, plan: Plan, folder: Path) -> tuple[float, float, int]:
    """Frames per second from the first shot to the last, CPU seconds a frame, frames lost."""
    times: list[float] = []
    cpu_s: list[float] = []

    def watch(progress: Progress) -> None:
        if progress.done > len(times) - 1:  # the first time with so many shots saved
            times.append(time.perf_counter())
            cpu_s.append(time.process_time())

    acquire(rig, plan, folder, progress=watch)
    acquisition = open_acquisition(folder)
    found = {
        hashlib.sha256(frame).digest()
        for shot in acquisition.shots
        for frame in acquisition.load_frames(shot)[0]
    }
    total = len(plan.steps()) * plan.frames
    frames = (len(times) - 1) * plan.frames
    rate, used_s = frames / (times[-1] - times[0]), (cpu_s[-1] - cpu_s[0]) / frames
    return rate, used_s, total - len(found)


def _syncs_per_s(folder: Path) -> float:
    line = b"x" * 200 + b"\n"
    with (folder / "syncs").open("wb", buffering=0) as stream:
        start = time.perf_counter()
        for _ in range(_FLOOR_SYNCS):
            stream.write(line)
            os.fsync(stream.fileno())
        return _FLOOR_SYNCS / (time.perf_counter() - start)


def main() -> None:
    """Prints a row for 1, 4 and 16 frames a shot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path(), help="on the disk to be measured")
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    print(f"{given.repeats} times {given.frames} frames of 640 x 512, {platform.system()}")
    print("frames a shot, best/s, median/s, worst/s, lost, CPU ms a frame, syncs/s, shots a sync")
    lost = 0
    for count in FRAMES_PER_SHOT:
        found = bench_rig(
            given.folder, frames=given.frames, frames_per_shot=count, repeats=given.repeats
        )
        rates, syncs = found.frames_per_s, found.syncs_per_s
        lost += found.lost
        print(
            f"{count}, {max(rates):.0f}, {statistics.median(rates):.0f}, {min(rates):.0f}, "
            f"{found.lost}, {1e3 * min(found.cpu_s):.1f}, {min(syncs):.0f}..{max(syncs):.0f}, "
            f"{found.shots_per_sync:.2f}"
        )
    if lost:
        raise SystemExit(f"{lost} frames are lost; do not acquire on this disk")
