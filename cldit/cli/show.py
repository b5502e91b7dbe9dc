"""`cldit show` and `cldit view`: maps of folders, and pages of them."""

import webbrowser
from pathlib import Path

import click

from cldit.api.viewing import view
from cldit.cli.console import OUT, escaped, plain_errors
from cldit.cli.options import PATH, figures_option
from cldit.show.report.folders import show_folder
from cldit.show.view.folders import unfinished


@click.command()
@click.argument("folder", type=PATH)
@figures_option
@click.option("--open", "opened", is_flag=True, help="Open the figure in the system's viewer.")
@plain_errors
def show(folder: Path, suffix: str | None, opened: bool) -> None:
    """Draw the figures of a run or acquisition FOLDER; of a series, its film."""
    figure = show_folder(folder, suffix=suffix or ".png")
    OUT.print(escaped(str(figure)))
    if opened:
        click.launch(str(figure))


@click.command("view")
@click.argument("folders", nargs=-1, required=True, type=PATH)
@click.option(
    "--save",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the page to this file, and do not open it.",
)
@click.option("--no-open", is_flag=True, help="Write the page and print its path only.")
@plain_errors
def view_command(folders: tuple[Path, ...], save: Path | None, no_open: bool) -> None:
    """Show runs, series and recordings in FOLDERS on one page: sliders, profiles, differences.

    The page needs no server and no network. It is written into the first folder, or into cldit's
    cache if that is not possible.
    """
    path = view(*folders, save=save)
    for folder in folders:
        for incomplete in unfinished(folder):
            OUT.print(escaped(f"{incomplete}: is not finished; omitted"))
    size = "" if save is None else f" ({save.stat().st_size / 1e6:.1f} MB)"
    OUT.print(escaped(f"{path}{size}"))
    if save is None and not no_open and not webbrowser.open(path.resolve().as_uri()):
        OUT.print("no browser was found; open the file in one")
