"""Reader plugin of napari: maps of runs and measurements as layers, in millimetres.

napari finds it by the entry point `napari.manifest`, which names cldit/napari.yaml.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cldit.acquisition.measured import is_measured
from cldit.comparison.shown import Shown, open_shown

Layer = tuple[Any, dict[str, Any], str]
Reader = Callable[[str | list[str]], list[Layer]]

_COLOURS = {"apparent temperature": "inferno", "emissivity": "gray", "optical depth": "viridis"}


def get_reader(path: str | list[str]) -> Reader | None:
    """Reader of a path, or a list of one; None if it is not a result of cldit."""
    place = _single_path(path)
    if place is None or not _is_result(place):
        return None
    return read_layers


def read_layers(path: str | list[str]) -> list[Layer]:
    """Layers of napari, (array, attributes, "image"), of a path for which there is a reader.

    Arrays (H, W) have row 0 at the top; scale and place are in mm, y downwards from the injector.
    """
    place = _single_path(path)
    assert place is not None  # checked by get_reader
    shown = open_shown(place)
    images = {
        "apparent temperature": (shown.maps.apparent_temperature_K, "K"),
        "emissivity": (shown.maps.emissivity, "1"),
        "optical depth": (shown.maps.optical_depth, "1"),
    }
    if shown.error_map_K is not None:
        images["error of apparent temperature"] = (shown.error_map_K.astype("float32"), "K")
    return [
        (image, _about(shown, f"{name} / {unit}" if unit != "1" else name, name), "image")
        for name, (image, unit) in images.items()
    ]


def _single_path(path: str | list[str]) -> Path | None:
    if isinstance(path, list):
        return Path(path[0]) if len(path) == 1 else None
    return Path(path)


def _is_result(place: Path) -> bool:
    if place.is_file():
        return place.name == "measured.yaml"
    return any((place / name).is_file() for name in ("run.json", "journal.jsonl")) or (
        is_measured(place)
    )


def _about(shown: Shown, title: str, name: str) -> dict[str, Any]:
    rows, columns = shown.maps.emissivity.shape
    width, height = (1e3 * length_m for length_m in shown.pixel_m)
    x, z = (1e3 * length_m for length_m in shown.centre_m)
    return {
        "name": title,
        "colormap": _COLOURS.get(name, "viridis"),
        "scale": (height, width),
        "translate": (-z - (rows - 1) / 2 * height, x - (columns - 1) / 2 * width),
        "units": ("mm", "mm"),
        "visible": name == "apparent temperature",
        "metadata": {"of": shown.name, "stated_error_K": shown.error_K},
    }
