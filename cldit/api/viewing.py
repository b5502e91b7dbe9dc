"""The page of `cldit view`, from a script."""

import webbrowser
from collections.abc import Sequence
from pathlib import Path

from cldit.errors import FileError, RunFolderError
from cldit.io.caches import default_cache
from cldit.io.content import digest
from cldit.io.files import make_folder
from cldit.show.view import Item, save_page, view_items


def view(*folders: str | Path, save: str | Path | None = None, open_browser: bool = False) -> Path:
    """Writes one page of runs, series and recordings: sliders, profiles, differences.

    The page needs no server and no network.

    Args:
        folders: runs, series, evaluated acquisitions or measured data.
        save: file of the page; None: view.html in the first folder, or in cldit's cache if that is
            not possible.
        open_browser: True shows it in the system's browser.

    Returns:
        Path of the page.

    Raises:
        RunFolderError: there is no folder, or one is not finished, damaged, or none of these.
        FileError: the file cannot be written.
    """
    if not folders:
        raise RunFolderError("view: no folder; allowed: one or more of runs, series or recordings")
    items = view_items(folders)
    if save is not None:
        path = Path(save)
        save_page(path, items)
    else:
        path = _written(Path(folders[0]), items)
    if open_browser:
        webbrowser.open(path.resolve().as_uri())
    return path


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
