"""`cldit bench rig`: how fast the runner saves."""

from __future__ import annotations

from pathlib import Path
from statistics import median

import click

from cldit.bench.rig import bench_rig
from cldit.cli.console import OUT, folded_table, plain_errors
from cldit.rig.errors import RigError

FRAMES_PER_SHOT = (1, 4, 16)


@click.command("rig")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path("."),
    help="On the disk to be measured; here.",
)
@click.option("--frames", type=click.IntRange(10, 7000), default=240, show_default=True)
@click.option("--repeats", type=click.IntRange(1, 100), default=5, show_default=True)
@click.option("--camera-rate", "rate_Hz", type=float, default=146.7, show_default=True)
@plain_errors
def bench_rig_command(folder: Path, frames: int, repeats: int, rate_Hz: float) -> None:
    """Full frames (640 x 512) that the runner saves per second, every guarantee kept."""
    table = folded_table("frames a shot", "best/s", "median/s", "worst/s", "lost", "CPU ms",
        "syncs/s", "shots a sync")  # fmt: skip
    lost = 0
    for count in FRAMES_PER_SHOT:
        result = bench_rig(folder, frames=frames, frames_per_shot=count, repeats=repeats)
        rates, syncs = result.frames_per_s, result.syncs_per_s
        lost += result.lost
        table.add_row(
            str(count),
            f"{max(rates):.0f}",
            f"{median(rates):.0f}",
            f"{min(rates):.0f}",
            str(result.lost),
            f"{1e3 * min(result.cpu_s):.1f}",
            f"{min(syncs):.0f}..{max(syncs):.0f}",
            f"{result.shots_per_sync:.2f}",
        )
    OUT.print(table)
    OUT.print(
        f"{repeats} times {frames} frames; the camera takes {rate_Hz:g}/s. CPU ms: for one frame. "
        "syncs/s: a bare loop of append and fsync beside each run"
    )
    if lost:
        raise RigError(f"{lost} frames are lost; do not acquire on this disk")
