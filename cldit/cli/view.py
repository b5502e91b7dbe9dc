"""`cldit view`: runs and recordings as a page in the browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from pathlib import Path

import click

from cldit.cli.console import OUT, escaped, plain_errors
from cldit.errors import FileError
from cldit.io.caches import default_cache
from cldit.io.content import digest
from cldit.io.files import make_folder
from cldit.show.view import Item, save_page, view_items
from cldit.show.view.folders import unfinished


@click.command("view")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--save",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the page to this file, to mail it, and open nothing.",
)
@click.option("--no-open", is_flag=True, help="Write the page and print its path.")
@plain_errors
def view_command(folders: tuple[Path, ...], save: Path | None, no_open: bool) -> None:
    """Runs, series and recordings in FOLDERS as one page: sliders, profiles, differences.

    The page needs no server and no network. It goes into the first folder, or where that cannot be
    written into cldit's cache.
    """
    items = view_items(folders)
    for folder in folders:
        for left in unfinished(folder):
            OUT.print(escaped(f"{left}: is not finished, and left out"))
    if save is not None:
        save_page(save, items)
        OUT.print(escaped(f"{save} ({save.stat().st_size / 1e6:.1f} MB)"))
        return
    path = _written(folders[0], items)
    OUT.print(escaped(str(path)))
    if not no_open and not webbrowser.open(path.resolve().as_uri()):
        OUT.print("no browser was found here; open the file in one")


def _written(folder: Path, items: Sequence[Item]) -> Path:
    """The page, in the folder or else in the cache."""
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
