"""`cldit optics`: optical properties of a scene."""

from pathlib import Path

import click

from cldit.cli.console import OUT, escaped, plain_errors, print_table
from cldit.cli.options import PATH, SCENE, figures_option
from cldit.io.files import make_folder
from cldit.run import default_cache
from cldit.scene import load_scene
from cldit.show.figures.optics_figures import optics_figure
from cldit.show.figures.style import write_figure
from cldit.show.report.optics_summary import scene_optics


@click.command()
@click.argument("scene", type=SCENE)
@click.option("--out", type=PATH, help="Figure (.png, .pdf or .svg); default: SCENE-optics.png.")
@figures_option
@plain_errors
def optics(scene: str, out: Path | None, suffix: str | None) -> None:
    """Print and draw optical properties of SCENE: liquid, droplets, vapour, camera."""
    if out is not None and suffix not in (None, out.suffix):
        raise click.UsageError(f"--format {suffix[1:]} and --out {out}: allowed: one of them")
    chosen = load_scene(scene)
    summary = scene_optics(chosen, cache=default_cache())
    rows = (
        (row.quantity, row.scene, row.data, row.paper, f"[dim]{escaped(row.note)}[/]")
        for row in summary.rows
    )
    print_table("", "scene", "data", "paper", "", rows=rows)
    for source in summary.sources:
        OUT.print(escaped(source), style="dim")
    figure = out or Path(f"{chosen.name}-optics{suffix or '.png'}")
    make_folder(figure.parent)
    write_figure(optics_figure(summary), figure)
    OUT.print(escaped(str(figure)))
