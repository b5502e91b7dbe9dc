"""`cldit show`: the maps of a folder."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.console import OUT, plain_errors
from cldit.show.report.run_report import show_folder


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--open", "opened", is_flag=True, help="Open the picture in the system's viewer.")
@plain_errors
def show(folder: Path, opened: bool) -> None:
    """The maps of a run or acquisition FOLDER, as a picture; of a series as its film."""
    picture = show_folder(folder)
    OUT.print(str(picture))
    if opened:
        click.launch(str(picture))
