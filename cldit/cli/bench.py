"""`cldit bench`: what this computer can do."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from cldit.acquisition.bench import bench_rig
from cldit.bench.case import Lattice
from cldit.bench.error import ACCURACIES_K
from cldit.bench.report import PARTS, Part, write_part
from cldit.bench.suite import MEASUREMENTS, USUAL, Bench
from cldit.cli.console import OUT, escaped, plain_errors, say
from cldit.gpu.device import open_device
from cldit.rig.errors import RigError
from cldit.run import default_cache
from cldit.scene import load_scene


@click.group(invoke_without_command=True)
@click.option("--scene", default="gdi", show_default=True, help="A shipped name or a YAML file.")
@click.option(
    "--only", "parts", multiple=True, type=click.Choice(PARTS), help="One part; may be repeated."
)
@click.option("--peers", is_flag=True, help="Also what others need, where it is installed.")
@click.option(
    "--every",
    type=click.IntRange(1),
    default=5,
    show_default=True,
    help="The reference, path and branching trace every n-th pixel across and down (odd); 1: all.",
)
@click.option(
    "--samples",
    type=click.IntRange(256),
    default=512,
    show_default=True,
    help="Of the reference, a pixel.",
)
@click.option(
    "--accuracy",
    "accuracies_K",
    type=float,
    multiple=True,
    default=ACCURACIES_K,
    show_default=True,
    help="K that source is asked for; may be repeated.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("bench"),
    show_default=True,
    help="Folder of benchmarks.md and of tables, pictures and JSON.",
)
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@click.pass_context
@plain_errors
def bench(
    context: click.Context,
    scene: str,
    parts: tuple[str, ...],
    peers: bool,
    every: int,
    samples: int,
    accuracies_K: tuple[float, ...],
    out: Path,
    device: str | None,
) -> None:
    """Measure this computer: error against run time of all methods, growth of cost, memory, what
    leaving out saves, kernels against the machine's floor."""
    if context.invoked_subcommand is not None:
        return
    opened = open_device(device)
    OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")

    def save(part: Part) -> None:
        command = f"cldit bench --scene {scene} --only {part.name} --out {out}"
        if part.name == "error":
            command += f" --every {every} --samples {samples}"
            command += "".join(f" --accuracy {kelvin:g}" for kelvin in accuracies_K)
        page = write_part(part, out, command=command, device=opened)
        OUT.print(f"{page}\n")

    measured = Bench(
        scene=load_scene(scene),
        device=opened,
        cache=default_cache(),
        lattice=Lattice((every, every)),
        samples=samples,
        accuracies_K=accuracies_K,
        say=say,
        save=save,
    )
    for name in parts or (*USUAL, *(["peers"] if peers else [])):
        part = MEASUREMENTS[name](measured)
        _show(part)
        save(part)


def _show(part: Part) -> None:
    OUT.print(part.title, style="bold")
    for table in part.tables:
        shown = Table(*table.head, box=None)
        for row in table.rows:
            shown.add_row(*row)
        OUT.print(shown)
    for text in part.text:
        OUT.print(escaped(text), style="dim")


@bench.command("rig")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path("."),
    help="On the disk to be measured; here.",
)
@click.option("--frames", type=click.IntRange(10, 7000), default=300, show_default=True)
@click.option("--camera-rate", "rate_Hz", type=float, default=146.7, show_default=True)
@plain_errors
def bench_rig_command(folder: Path, frames: int, rate_Hz: float) -> None:
    """Full frames (640 x 512) that the runner saves per second, every guarantee kept."""
    result = bench_rig(folder, frames=frames)
    OUT.print(
        f"{result.frames_per_s:.0f} frames/s saved, {result.lost} lost; the camera takes "
        f"{rate_Hz:g}/s"
    )
    if result.lost:
        raise RigError(f"{result.lost} frames are lost; do not acquire on this disk")
