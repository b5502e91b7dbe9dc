"""`cldit bench` itself: the parts that measure the transport."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cldit.bench import BUDGET_SCENES
from cldit.bench.case import Lattice
from cldit.bench.report import Part, write_part
from cldit.bench.suite import MEASUREMENTS, USUAL, Bench
from cldit.cli.console import OUT, escaped, folded_table, say
from cldit.gpu.device import open_device
from cldit.run import default_cache
from cldit.scene import load_scene


@dataclass(frozen=True)
class Asked:
    """The options of `cldit bench`."""

    scene: str
    parts: tuple[str, ...]
    mitsuba: bool
    every: int
    samples: int
    accuracies_K: tuple[float, ...]
    pixels: int
    asked_K: tuple[float, ...]
    seeds: int
    budget_scenes: tuple[str, ...]
    out: Path
    device: str | None

    def command(self, part: str) -> str:
        """What makes this part alone."""
        command = f"cldit bench --scene {self.scene} --only {part} --out {self.out}"
        if part == "budget":
            command += f" --pixels {self.pixels} --seeds {self.seeds}"
            command += "".join(f" --asked {asked_K:g}K" for asked_K in self.asked_K)
            if self.budget_scenes != BUDGET_SCENES:
                command += "".join(f" --budget-scene {name}" for name in self.budget_scenes)
        if part == "error":
            command += f" --every {self.every} --samples {self.samples}"
            command += "".join(f" --accuracy {accuracy_K:g}K" for accuracy_K in self.accuracies_K)
        return command


def bench_transport(asked: Asked) -> None:
    """Runs the parts one by one, and prints and saves each as it ends."""
    device = open_device(asked.device)
    OUT.print(f"OpenCL device {device.info.index} {device.info.name}: {device.reason}")

    def save(part: Part) -> None:
        page = write_part(part, asked.out, command=asked.command(part.name), device=device)
        OUT.print(f"{page}\n")

    measured = Bench(
        scene=load_scene(asked.scene),
        device=device,
        cache=default_cache(),
        lattice=Lattice((asked.every, asked.every)),
        samples=asked.samples,
        accuracies_K=asked.accuracies_K,
        say=say,
        save=save,
        pixels=asked.pixels,
        asked_K=asked.asked_K,
        seeds=asked.seeds,
        budget_scenes=asked.budget_scenes,
    )
    for name in asked.parts or (*USUAL, *(["mitsuba"] if asked.mitsuba else [])):
        part = MEASUREMENTS[name](measured)
        _show(part)
        save(part)


def _show(part: Part) -> None:
    OUT.print(part.title, style="bold")
    for table in part.tables:
        shown = folded_table(*table.head)
        for row in table.rows:
            shown.add_row(*row)
        OUT.print(shown)
    for text in part.text:
        OUT.print(escaped(text), style="dim")
