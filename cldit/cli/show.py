"""`cldit show`, `cldit view` and `cldit gallery`: maps of folders, and pages of them."""

import webbrowser
from collections.abc import Sequence
from pathlib import Path

import click

from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors
from cldit.cli.options import PATH, device_option, figures_option, pixels_of
from cldit.errors import FileError
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.io.content import digest
from cldit.io.files import make_folder
from cldit.scene import shipped_scenes
from cldit.scene.load import short_changes
from cldit.show.report.folders import show_folder
from cldit.show.report.gallery import write_gallery
from cldit.show.view import Item, save_page, view_items
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
    items = view_items(folders)
    for folder in folders:
        for left in unfinished(folder):
            OUT.print(escaped(f"{left}: is not finished; omitted"))
    if save is not None:
        save_page(save, items)
        OUT.print(escaped(f"{save} ({save.stat().st_size / 1e6:.1f} MB)"))
        return
    path = _written(folders[0], items)
    OUT.print(escaped(str(path)))
    if not no_open and not webbrowser.open(path.resolve().as_uri()):
        OUT.print("no browser was found; open the file in one")


def _written(folder: Path, items: Sequence[Item]) -> Path:
    """Path of the page, written in the folder or else in the cache."""
    place = folder if folder.is_dir() else folder.parent
    path = place / "view.html"
    try:
        save_page(path, items)
    except FileError:
        name = f"{items[0].head['name']}-{digest(str(place.resolve()))[:8]}.html"
        path = default_cache() / "view" / name.replace("/", "-")
        make_folder(path.parent)
        save_page(path, items)
    return path


@click.command("gallery")
@click.argument("scenes", nargs=-1)
@click.option(
    "--out",
    default="gallery",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the page.",
)
@click.option("--pixels", metavar="N|NxM", help="Columns and rows of the images; default: 128.")
@device_option
@plain_errors
def gallery_command(
    scenes: tuple[str, ...], out: Path, pixels: str | None, device: str | None
) -> None:
    """Write a page of SCENES, or of all shipped ones: figure, command, seconds, error.

    Each is simulated as by `cldit run --quick --trace-only`.
    """
    more = "" if pixels is None else f" --pixels {pixels}"
    with ProgressBar() as bar:
        page = write_gallery(
            scenes or tuple(shipped_scenes()),
            out,
            options=f"--quick{more} --trace-only",
            changes=short_changes(quick=True, pixels=None if pixels is None else pixels_of(pixels)),
            device=open_device(device),
            progress=bar.say,
        )
    OUT.print(escaped(str(page)))
