"""What lies in a folder that is to be viewed: a run, a series of runs, or a recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from cldit.acquisition.measured import is_measured
from cldit.acquisition.storage import PLAN
from cldit.errors import RunFolderError
from cldit.io.plain_data import read_mapping
from cldit.run import open_run
from cldit.show.view.item import Item
from cldit.show.view.measured import measured_items
from cldit.show.view.traced import traced_item


def view_items(folders: Iterable[str | Path]) -> tuple[Item, ...]:
    """What a page of these folders shows, in this order.

    Args:
        folders: of runs, of evaluated acquisitions or measured data, or of a series, which is a
            folder of run folders; those are sorted by the time that each run has recorded.

    Raises:
        RunFolderError: a folder is none of these, is not finished, or is damaged.
        ClditError: measured data are not as they must be.
    """
    return tuple(item for folder in folders for item in _items(Path(folder)))


def _items(folder: Path) -> Iterator[Item]:
    if is_run(folder):
        yield traced_item(open_run(folder), source=str(folder / "scene.yaml"))
    elif is_measured(folder) or (folder / PLAN).is_file():
        yield from measured_items(folder)
    else:
        runs = series(folder)
        if not runs:
            raise RunFolderError(
                f"{folder}: holds nothing to view; allowed is the folder of a run, of an "
                "evaluated acquisition or measured data, or of a series of runs"
            )
        for run in runs:
            yield from _items(run)


def is_run(folder: Path) -> bool:
    """Whether a run was begun here."""
    return (folder / "scene.yaml").is_file()


def series(folder: Path) -> tuple[Path, ...]:
    """The finished runs in a folder, by the time of their sprays; those without one by name."""
    runs = [each for each in _runs_in(folder) if (each / "run.json").is_file()]
    return tuple(sorted(runs, key=_time_s))


def unfinished(folder: Path) -> tuple[Path, ...]:
    """The runs of a series that are left out, since they were not finished."""
    if is_run(folder):
        return ()
    return tuple(each for each in _runs_in(folder) if not (each / "run.json").is_file())


def _runs_in(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return [each for each in sorted(folder.iterdir()) if is_run(each)]


def _time_s(run: Path) -> float:
    spray = read_mapping(run / "scene.yaml").get("spray")
    time_s = spray.get("time_s") if isinstance(spray, dict) else None
    return float(time_s) if isinstance(time_s, (int, float)) else 0.0
