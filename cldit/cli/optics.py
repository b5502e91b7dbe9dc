"""`cldit optics`: what a scene's matter and camera do to light."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.console import OUT, escaped, folded_table, plain_errors
from cldit.cli.scene_name import SCENE
from cldit.io.files import make_folder, write_bytes
from cldit.run import default_cache
from cldit.scene import load_scene
from cldit.show.figures.optics_figures import optics_picture
from cldit.show.report.optics_summary import scene_optics


@click.command()
@click.argument("scene", type=SCENE)
@click.option("--out", type=click.Path(path_type=Path), help="The picture; SCENE-optics.png.")
@plain_errors
def optics(scene: str, out: Path | None) -> None:
    """What SCENE's liquid, droplets, vapour and camera do to light: printed, and as a picture."""
    chosen = load_scene(scene)
    found = scene_optics(chosen, cache=default_cache())
    table = folded_table("", "scene", "data", "paper", "")
    for row in found.rows:
        table.add_row(row.quantity, row.scene, row.data, row.paper, f"[dim]{escaped(row.note)}[/]")
    OUT.print(table)
    for source in found.sources:
        OUT.print(escaped(source), style="dim")
    picture = out or Path(f"{chosen.name}-optics.png")
    make_folder(picture.parent)
    write_bytes(picture, optics_picture(found))
    OUT.print(str(picture))
