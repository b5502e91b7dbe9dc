"""`cldit bench`: error against run time on this machine."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cldit.bench import ACCURACIES_K, ASKED_K, BUDGET_SCENES, PARTS
from cldit.cli.console import OUT, escaped, plain_errors, print_table, say
from cldit.cli.options import KELVIN, PATH, device_option, figures_option

if TYPE_CHECKING:
    from cldit.bench.report import Part


@dataclass(frozen=True)
class Options:
    """Options of `cldit bench`."""

    scene: str
    parts: tuple[str, ...]
    every: int
    samples: int
    accuracies_K: tuple[float, ...]
    pixels: int
    asked_K: tuple[float, ...]
    seeds: int
    budget_scenes: tuple[str, ...]
    out: Path
    device: str | None
    suffix: str | None

    def command(self, part: str) -> str:
        """Command that makes one part again."""
        if part == "error":
            command = f"cldit bench --only error --scene {self.scene} --out {self.out}"
            command += f" --every {self.every} --samples {self.samples}"
            return command + "".join(f" --accuracy {kelvin:g}K" for kelvin in self.accuracies_K)
        command = f"cldit bench --only budget --out {self.out}"
        command += f" --pixels {self.pixels} --seeds {self.seeds}"
        command += "".join(f" --asked {kelvin:g}K" for kelvin in self.asked_K)
        if self.budget_scenes != BUDGET_SCENES:
            command += "".join(f" --budget-scene {name}" for name in self.budget_scenes)
        return command


@click.command()
@click.option(
    "--only",
    "parts",
    multiple=True,
    type=click.Choice(PARTS),
    help="One part: whole runs (budget), or single traces (error); both if omitted.",
)
@click.option(
    "--asked",
    "asked_K",
    type=KELVIN,
    multiple=True,
    default=ASKED_K,
    help="budget: tolerance of T_app in K; may be repeated.",
)
@click.option(
    "--budget-scene",
    "budget_scenes",
    type=click.Choice(BUDGET_SCENES),
    multiple=True,
    default=BUDGET_SCENES,
    help="budget: a scene with a reference image; may be repeated. Rows of others in budget.json "
    "of --out are kept.",
)
@click.option(
    "--seeds", type=click.IntRange(1), default=1, help="budget: runs with each tolerance."
)
@click.option(
    "--pixels",
    type=click.IntRange(16),
    default=100,
    help="budget: pixels along an edge, as many as the references have.",
)
@click.option("--scene", default="gdi", help="error: a shipped name or a YAML file.")
@click.option(
    "--accuracy",
    "accuracies_K",
    type=KELVIN,
    multiple=True,
    default=ACCURACIES_K,
    help="error: accuracy of `source` in K; may be repeated.",
)
@click.option(
    "--every",
    type=click.IntRange(1),
    default=5,
    help="error: the reference and `path` trace every n-th pixel across and down (odd); 1: all.",
)
@click.option(
    "--samples",
    type=click.IntRange(256),
    default=512,
    help="error: samples per pixel of the reference.",
)
@click.option(
    "--out", type=PATH, default=Path("bench"), help="Folder of the pages, figures and JSON."
)
@figures_option
@device_option
@plain_errors
def bench(**given: Any) -> None:
    """Measure error against run time: of whole runs, with true and stated error, and of single
    traces by the methods `source` and `path`."""
    from cldit.bench.budget import budget, stored_rows  # slow imports, not for `--help`
    from cldit.bench.case import Lattice
    from cldit.bench.error import error
    from cldit.bench.report import write_part
    from cldit.gpu.device import open_device
    from cldit.run import default_cache
    from cldit.scene import load_scene

    options = Options(**given)
    device = open_device(options.device)
    OUT.print(f"OpenCL device {device.info.index} {device.info.name}: {device.reason}")

    def save(part: "Part") -> None:
        page = write_part(
            part,
            options.out,
            command=options.command(part.name),
            device=device,
            suffix=options.suffix,
        )
        OUT.print(f"{page}\n")

    for name in options.parts or PARTS:
        if name == "budget":
            part = budget(
                device,
                cache=default_cache(),
                say=say,
                save=save,
                pixels=options.pixels,
                asked_K=options.asked_K,
                seeds=options.seeds,
                scenes=options.budget_scenes,
                before=stored_rows(options.out, pixels=options.pixels),
            )
        else:
            part = error(
                load_scene(options.scene),
                device,
                cache=default_cache(),
                lattice=Lattice((options.every, options.every)),
                say=say,
                save=save,
                accuracies_K=options.accuracies_K,
                reference_samples=options.samples,
            )
        _show(part)
        save(part)


def _show(part: "Part") -> None:
    OUT.print(part.title, style="bold")
    for table in part.tables:
        print_table(*table.head, rows=table.rows)
    for text in part.text:
        OUT.print(escaped(text), style="dim")
