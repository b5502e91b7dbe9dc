"""`cldit bench` itself: error, growth, memory, leaving out and the floor of the transport."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from cldit.bench.case import Lattice
from cldit.bench.report import Part, write_part
from cldit.bench.suite import MEASUREMENTS, USUAL, Bench
from cldit.cli.console import OUT, escaped, say
from cldit.gpu.device import open_device
from cldit.run import default_cache
from cldit.scene import load_scene


def bench_transport(
    scene: str,
    *,
    parts: tuple[str, ...],
    peers: bool,
    every: int,
    samples: int,
    accuracies_K: tuple[float, ...],
    out: Path,
    device: str | None,
) -> None:
    """Runs the parts one by one, and prints and saves each as it ends."""
    opened = open_device(device)
    OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")

    def save(part: Part) -> None:
        command = f"cldit bench --scene {scene} --only {part.name} --out {out}"
        if part.name == "error":
            command += f" --every {every} --samples {samples}"
            command += "".join(f" --accuracy {kelvin:g}K" for kelvin in accuracies_K)
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
