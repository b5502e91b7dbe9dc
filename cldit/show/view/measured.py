"""An evaluated recording as the page needs it: its maps as they are stored."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.measured import Measured, is_measured, open_measured
from cldit.acquisition.record import maps_folder, open_acquisition
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.io.images import read_image
from cldit.optics.response import from_plain
from cldit.scene.delays import delay_text
from cldit.show.view.item import Item, place, planck_ends, planck_tables
from cldit.show.view.packing import ERROR_BITS, MANTISSA_BITS, rounded

_TOTAL = {
    "temperature_total_error": "apparent_temperature_total_error_K.tif",
    "emissivity_total_error": "emissivity_total_error.tif",
}


def measured_items(folder: Path) -> Iterator[Item]:
    """The evaluated delays of an acquisition, or measured data, one after the other.

    Args:
        folder: of the acquisition; or with measured.yaml, or such a file itself.

    Raises:
        RunFolderError: it is not evaluated yet, or a map is missing or damaged.
        EvaluationError, SceneError: as `cldit.acquisition.measured.open_measured`.
    """
    opened = open_measured(folder) if is_measured(folder) else open_acquisition(folder)
    delays: tuple[float, ...] = ()
    name = opened.folder.resolve().name
    if isinstance(opened, Measured):
        name = opened.name
    else:
        delays = opened.plan.delays
        if name == "acquisition":
            name = f"{opened.folder.resolve().parent.name}, acquired"
    head: dict[str, Any] = {"kind": "measurement", "source": str(folder), "about": ""}
    filter_um = from_plain(opened.calibration["filter_um"])
    head["ends"] = planck_ends(filter_um)
    found = 0
    for number in range(max(len(delays), 1)):
        maps = maps_folder(opened.folder, delays, number)
        if not maps.is_dir():
            continue
        found += 1
        arrays = _arrays(maps)
        many = len(delays) > 1
        one = {
            **head,
            "name": f"{name}, {delay_text(delays[number])}" if many else name,
            "time_s": delays[number] if delays else None,
            **place(arrays["reason"].shape, opened.pixel_m, opened.centre_m),
        }
        yield Item(one, {**planck_tables(filter_um), **arrays})
    if not found:
        raise RunFolderError(f"{folder}: is not evaluated yet; run `cldit evaluate {folder}` first")


def _arrays(folder: Path) -> dict[str, NDArray[Any]]:
    """(H, W) maps by the page's names; NaN where there is no value."""
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
