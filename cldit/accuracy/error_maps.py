"""Maps of the standard error of T_app in every pixel, of each cause and of all together.

A difference of two pictures is one draw of an error: in single pixels it is small by chance. The
map of a cause is the RMS of its differences nearby, and scaled so that the RMS over all pixels that
have a T_app is the error that the run states.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from cldit.accuracy.errors import Errors
from cldit.io.files import make_folder
from cldit.io.images import read_image, write_image

Image = NDArray[np.float32]
TOTAL = "total"
_NEARBY = 0.05  # of the picture's edge: that of the square around a pixel that counts as nearby


def error_maps(
    errors: Errors,
    differences_K: Mapping[str, NDArray[np.float64]],
    counted: NDArray[np.bool_],
) -> dict[str, Image]:
    """Standard errors by cause; NaN in pixels that do not count.

    Causes without a map have the same error everywhere in the total, and none of their own.

    Args:
        errors: what the run states.
        differences_K: (H, W) sizes of differences by the cause's name; NaN where unknown.
        counted: (H, W), pixels that have a T_app.

    Returns:
        (H, W) float32 for each cause with a map, and the total; nothing where no pixel counts.
    """
    if not counted.any() or errors.total_K is None:
        return {}
    out: dict[str, Image] = {}
    square = np.zeros(counted.shape)
    for cause in errors.causes:
        if cause.error_K is None:
            continue
        given = differences_K.get(cause.name)
        one = None if given is None else _nearby(given, counted)
        if one is None:
            square += cause.error_K**2
            continue
        rms = float(np.sqrt(np.mean(one[counted] ** 2)))
        one *= cause.error_K / rms if rms > 0 else 0.0
        square += one**2
        out[cause.name] = np.where(counted, one, np.nan).astype(np.float32)
    out[TOTAL] = np.where(counted, np.sqrt(square), np.nan).astype(np.float32)
    return out


def _nearby(
    difference_K: NDArray[np.float64], counted: NDArray[np.bool_]
) -> NDArray[np.float64] | None:
    """Local RMS of a map; None where nothing of it is known."""
    known = np.isfinite(difference_K) & counted
    if not known.any():
        return None
    width = max(3, round(_NEARBY * max(counted.shape)))
    weight = uniform_filter(known.astype(float), width)
    square = uniform_filter(np.where(known, np.nan_to_num(difference_K) ** 2, 0.0), width)
    mean = float(np.mean(difference_K[known] ** 2))
    local = np.divide(square, weight, out=np.full(square.shape, mean), where=weight > 1e-3)
    return np.asarray(np.sqrt(np.maximum(local, 0.0)))  # running sums leave rounding below 0


def save_maps(maps: Mapping[str, Image], folder: Path, *, pixel_m: tuple[float, float]) -> None:
    """Writes each map as float32 TIFF, `total.tif`, `cells.tif`, ..

    Args:
        maps: by name.
        folder: is made where there is something to write.
        pixel_m: width and height of a pixel.
    """
    for name, image in maps.items():
        make_folder(folder)
        what = "standard error of the apparent temperature"
        what += "" if name == TOTAL else f" by {name}"
        path = folder / f"{name.replace(' ', '_')}.tif"
        write_image(path, image, name=what, unit="K", pixel_m=pixel_m)


def load_maps(folder: Path) -> dict[str, Image]:
    """What `save_maps` wrote; nothing where there is no such folder.

    Raises:
        RunFolderError: a file is damaged.
    """
    files = sorted(folder.glob("*.tif"))
    return {file.stem.replace("_", " "): read_image(file)[0] for file in files}
