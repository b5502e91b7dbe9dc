"""`cldit export`: an acquisition's raw pictures in one file."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.acquisition.export import FORMATS, export
from cldit.acquisition.record import open_acquisition
from cldit.cli.console import OUT, plain_errors


@click.command("export")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--to", "form", type=click.Choice(list(FORMATS)), required=True)
@click.option("--out", type=click.Path(path_type=Path), help="The file; in FOLDER if left out.")
@plain_errors
def export_command(folder: Path, form: str, out: Path | None) -> None:
    """Write the raw pictures of an acquisition FOLDER (or that of a run) into one file."""
    acquisition = open_acquisition(_acquisition_in(folder))
    path = export(acquisition, form, out)
    if acquisition.missing:
        OUT.print(f"[yellow]{len(acquisition.missing)} shots are still to be taken[/]")
    OUT.print(f"{path}: {len(acquisition.shots)} shots, {path.stat().st_size / 1e6:.1f} MB")


def _acquisition_in(folder: Path) -> Path:
    return folder / "acquisition" if (folder / "acquisition").is_dir() else folder
