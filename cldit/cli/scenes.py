"""`cldit scenes`: what is shipped, and the reference of every key."""

from __future__ import annotations

import json

import click
from rich.table import Table

from cldit.cli.console import OUT, plain_errors
from cldit.scene import Scene, load_scene, shipped_scenes
from cldit.scene.commented import commented
from cldit.terminal import tell


@click.command()
@click.option("--show", metavar="SCENE", help="A scene as commented YAML, to save and edit.")
@click.option("--reference", is_flag=True, help="Every key of all files, as Markdown.")
@click.option("--schema", is_flag=True, help="JSON schema of scenes, for editors.")
@plain_errors
def scenes(show: str | None, reference: bool, schema: bool) -> None:
    """The scenes that are shipped."""
    if show is not None:
        tell(commented(load_scene(show)), end="")
        return
    if reference:
        from cldit.report.keys import reference_page  # imports what reads rigs and pictures

        tell(reference_page(), end="")
        return
    if schema:
        tell(json.dumps(Scene.model_json_schema(), indent=2))
        return
    table = Table("scene", "", box=None)
    for name, description in shipped_scenes().items():
        table.add_row(name, description)
    OUT.print(table)
