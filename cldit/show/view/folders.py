"""Items of a folder to be viewed: a run, a series of runs, or an evaluated recording."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.measured import Measured, is_measured, open_recorded
from cldit.acquisition.storage import PLAN
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.io.images import read_image
from cldit.io.plain_data import read_mapping
from cldit.optics.response import from_plain
from cldit.run import open_run
from cldit.show.report.folders import evaluated_maps
from cldit.show.view.item import Item, place_of, planck_ends, planck_tables
from cldit.show.view.packing import ERROR_BITS, MANTISSA_BITS, rounded
from cldit.show.view.traced import traced_item

_TOTAL = {
    "temperature_total_error": "apparent_temperature_total_error_K.tif",
    "emissivity_total_error": "emissivity_total_error.tif",
}


def view_items(folders: Iterable[str | Path]) -> tuple[Item, ...]:
    """Reads the items of a page from folders, in this order.

    Args:
        folders: runs, evaluated acquisitions or measured data, or series, which are folders of run
            folders; these are sorted by the time of their sprays.

    Returns:
        Items for `save_page`.

    Raises:
        RunFolderError: a folder is none of these, is not finished, or is damaged.
        ClditError: measured data are not valid.
    """
    return tuple(item for folder in folders for item in _items(Path(folder)))


def _items(folder: Path) -> Iterator[Item]:
    if is_run(folder):
        yield traced_item(open_run(folder), source=str(folder / "scene.yaml"))
    elif is_measured(folder) or (folder / PLAN).is_file():
        yield from _measured_items(folder)
    else:
        runs = series(folder)
        if not runs:
            raise RunFolderError(
                f"{folder}: contains nothing to view; allowed: the folder of a run, of an "
                "evaluated acquisition or measured data, or of a series of runs"
            )
        for run in runs:
            yield from _items(run)


def is_run(folder: Path) -> bool:
    """True if a run was begun in this folder."""
    return (folder / "scene.yaml").is_file()


def series(folder: Path) -> tuple[Path, ...]:
    """Finished runs in a folder, by the time of their sprays; those without a time by name."""
    runs = [run for run in _runs_in(folder) if (run / "run.json").is_file()]
    return tuple(sorted(runs, key=_time_s))


def unfinished(folder: Path) -> tuple[Path, ...]:
    """Runs of a series that are omitted, since they were not finished."""
    if is_run(folder):
        return ()
    return tuple(run for run in _runs_in(folder) if not (run / "run.json").is_file())


def _runs_in(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return [path for path in sorted(folder.iterdir()) if is_run(path)]


def _time_s(run: Path) -> float:
    spray = read_mapping(run / "scene.yaml").get("spray")
    time_s = spray.get("time_s") if isinstance(spray, dict) else None
    return float(time_s) if isinstance(time_s, (int, float)) else 0.0


def _measured_items(folder: Path) -> Iterator[Item]:
    """Evaluated filters and delays of an acquisition, or measured data; the page shows the maps as
    stored."""
    opened = open_recorded(folder)
    place = opened.folder.resolve()
    name = f"{place.parent.name}, acquired" if place.name == "acquisition" else place.name
    if isinstance(opened, Measured):
        name = opened.name
    head: dict[str, Any] = {"kind": "measurement", "source": str(folder), "about": ""}
    for maps, group, words in evaluated_maps(opened):
        if isinstance(opened, Measured) or group is None:
            calibration, time_s = opened.calibration, None
        else:
            calibration, time_s = opened.calibrations[group.filter], opened.plan.delays[group.delay]
        arrays, filter_um = _arrays(maps), from_plain(calibration["filter_um"])
        item_head = {
            **head,
            "ends": planck_ends(filter_um),
            "name": ", ".join((name, *words)),
            "time_s": time_s,
            **place_of(arrays["reason"].shape, opened.pixel_m, opened.centre_m),
        }
        yield Item(item_head, {**planck_tables(filter_um), **arrays})


def _arrays(folder: Path) -> dict[str, NDArray[Any]]:
    """Maps (H, W) by the page's names; NaN where there is no value."""
    maps = Maps.load(folder)
    arrays: dict[str, NDArray[Any]] = {
        "temperature": rounded(maps.apparent_temperature_K, MANTISSA_BITS),
        "emissivity": rounded(maps.emissivity, MANTISSA_BITS),
        "temperature_error": rounded(maps.apparent_temperature_standard_error_K, ERROR_BITS),
        "emissivity_error": rounded(maps.emissivity_standard_error, ERROR_BITS),
        "reason": maps.reason.astype(np.uint8),
    }
    for name, file in _TOTAL.items():
        if (folder / file).is_file():
            arrays[name] = rounded(read_image(folder / file)[0], ERROR_BITS)
    for name, image in arrays.items():
        if image.shape != maps.reason.shape:
            raise RunFolderError(
                f"{folder}: is damaged ({name} has shape {image.shape}, expected "
                f"{maps.reason.shape}); run `cldit evaluate` again"
            )
    return arrays
