"""`cldit bench`: error against run time on this machine."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cldit.bench import ASKED_K, BUDGET_SCENES
from cldit.cli.console import OUT, escaped, plain_errors, print_table, say
from cldit.cli.options import KELVIN, PATH, device_option, figures_option

if TYPE_CHECKING:
    from cldit.bench.report import Part


@click.command()
@click.option(  # earlier versions had another part, which is in tests/bench
    "--only", type=click.Choice(("budget",)), expose_value=False, hidden=True
)
@click.option(
    "--asked",
    "asked_K",
    type=KELVIN,
    multiple=True,
    default=ASKED_K,
    help="Tolerance of T_app in K; may be repeated.",
)
@click.option(
    "--budget-scene",
    "scenes",
    type=click.Choice(BUDGET_SCENES),
    multiple=True,
    default=BUDGET_SCENES,
    help="A scene with a reference image; may be repeated. Rows of others in budget.json of --out "
    "are kept.",
)
@click.option("--seeds", type=click.IntRange(1), default=1, help="Runs with each tolerance.")
@click.option(
    "--pixels",
    type=click.IntRange(16),
    default=100,
    help="Pixels along an edge, as many as the references have.",
)
@click.option(
    "--out", type=PATH, default=Path("bench"), help="Folder of the page, figure and JSON."
)
@figures_option
@device_option
@plain_errors
def bench(
    asked_K: tuple[float, ...],
    scenes: tuple[str, ...],
    seeds: int,
    pixels: int,
    out: Path,
    suffix: str | None,
    device: str | None,
) -> None:
    """Measure true and stated error of whole runs against their run time."""
    from cldit.bench.budget import budget, stored_rows  # slow imports, not for `--help`
    from cldit.bench.report import write_part
    from cldit.run import default_cache
    from cldit.run.trusted import open_device

    opened = open_device(device)
    OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")
    command = f"cldit bench --only budget --out {out} --pixels {pixels} --seeds {seeds}"
    command += "".join(f" --asked {kelvin:g}K" for kelvin in asked_K)
    if scenes != BUDGET_SCENES:
        command += "".join(f" --budget-scene {name}" for name in scenes)

    def save(part: "Part") -> None:
        page = write_part(part, out, command=command, device=opened, suffix=suffix)
        OUT.print(f"{page}\n")

    part = budget(
        opened,
        cache=default_cache(),
        say=say,
        save=save,
        pixels=pixels,
        asked_K=asked_K,
        seeds=seeds,
        scenes=scenes,
        earlier_rows=stored_rows(out, pixels=pixels),
    )
    OUT.print(part.title, style="bold")
    for table in part.tables:
        print_table(*table.titles, rows=[[str(cell) for cell in row] for row in table.rows])
    for paragraph in part.text:
        OUT.print(escaped(paragraph), style="dim")
    save(part)
