"""Maps along a line, such as the axis of a plume."""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError
from cldit.io.files import write_text
from cldit.io.presented import Presented
from cldit.io.text_tables import csv_text


@dataclass(frozen=True)
class Profile(Presented):
    """Values at N points of a line, (N,) each, NaN where there is none.

    distance_m: from the start of the line. Values are those of the pixel at each point. `plot()`
    draws them, `plot(ax=..)` T_app into other axes, with `emissivity=True` the emissivity.
    """

    _FIGURE: ClassVar[str] = "profile"

    distance_m: Floats
    x_m: Floats
    z_m: Floats
    apparent_temperature_K: Floats
    apparent_temperature_standard_error_K: Floats
    emissivity: Floats
    emissivity_standard_error: Floats

    def __repr__(self) -> str:
        kelvin = self.apparent_temperature_K[np.isfinite(self.apparent_temperature_K)]
        warm = f", {kelvin.min():.4g} to {kelvin.max():.4g} K" if kelvin.size else ", no T_app"
        long = 1e3 * float(self.distance_m[-1])
        return f"<Profile: {self.distance_m.size} points over {long:.4g} mm{warm}>"

    def csv(self) -> str:
        """CSV with a heading and a row for each point."""
        names = [item.name for item in fields(self)]
        rows = np.stack([getattr(self, name) for name in names], axis=1)
        return csv_text(names, ([f"{value:.7g}" for value in row] for row in rows))

    def save(self, path: str | Path) -> None:
        """Writes `csv` to a file, which is replaced if it exists."""
        write_text(Path(path), self.csv())


def profile_of(
    maps: Maps,
    *,
    pixel_m: tuple[float, float],
    centre_m: tuple[float, float],
    start_m: tuple[float, float] = (0.0, 0.0),
    angle_deg: float | None = None,
    temperature_error_K: NDArray[np.floating] | None = None,
) -> Profile:
    """Profile of maps (H, W) from a point to the edge of the image, in steps of a pixel.

    Args:
        start_m: (x, z) of the start, the injector tip.
        angle_deg: from downwards (-z) towards +x; None: along the plume, the direction of the
            largest sum of emissivities.
        temperature_error_K: (H, W) standard error of T_app; None: that of the maps.
    """
    shape = maps.emissivity.shape
    if angle_deg is None:
        angle_deg = _plume_deg(maps.emissivity, pixel_m, centre_m, start_m)
    distance_m, x_m, z_m, row, column = _places(shape, pixel_m, centre_m, start_m, angle_deg)
    if not distance_m.size:
        raise EvaluationError(
            f"profile: x {1e3 * start_m[0]:g}, z {1e3 * start_m[1]:g} mm is outside the image"
        )
    error_K = (
        maps.apparent_temperature_standard_error_K
        if temperature_error_K is None
        else temperature_error_K
    )
    values = [
        np.asarray(image[row, column], np.float64)
        for image in (
            maps.apparent_temperature_K,
            error_K,
            maps.emissivity,
            maps.emissivity_standard_error,
        )
    ]
    return Profile(distance_m, x_m, z_m, *values)


def _plume_deg(
    emissivity: NDArray[np.float32],
    pixel_m: tuple[float, float],
    centre_m: tuple[float, float],
    start_m: tuple[float, float],
) -> float:
    values = np.nan_to_num(emissivity)

    def total(angle_deg: float) -> float:
        _, _, _, row, column = _places(values.shape, pixel_m, centre_m, start_m, angle_deg)
        return float(values[row, column].sum())

    # Directions a pixel apart at the end of the longest line; an odd number has straight down. Of
    # equal sums the one nearest to it.
    count = 2 * math.ceil(math.pi / 2.0 * math.hypot(*values.shape)) + 1
    angles = sorted(np.linspace(-90.0, 90.0, count), key=abs)
    return float(max(angles, key=total))


def _places(
    shape: tuple[int, ...],
    pixel_m: tuple[float, float],
    centre_m: tuple[float, float],
    start_m: tuple[float, float],
    angle_deg: float,
) -> tuple[Floats, Floats, Floats, Ints, Ints]:
    """Distance, x, z, row and column of each point in the image, up to its edge."""
    rows, columns = shape
    step_m = min(pixel_m)
    count = 2 + int(math.hypot(columns * pixel_m[0], rows * pixel_m[1]) / step_m)
    distance_m: Floats = np.arange(count, dtype=np.float64) * step_m
    angle = math.radians(angle_deg)
    x_m = start_m[0] + distance_m * math.sin(angle)
    z_m = start_m[1] - distance_m * math.cos(angle)
    row, column = pixels_at(shape, pixel_m, centre_m, x_m, z_m)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    end = count if inside.all() else int(np.argmin(inside))
    x_m, z_m = np.asarray(x_m[:end], np.float64), np.asarray(z_m[:end], np.float64)
    return distance_m[:end], x_m, z_m, row[:end], column[:end]


def pixels_at(
    shape: tuple[int, ...],
    pixel_m: tuple[float, float],
    centre_m: tuple[float, float],
    x_m: Floats,
    z_m: Floats,
) -> tuple[Ints, Ints]:
    """Row and column of the pixels at points, beyond the image too."""
    rows, columns = shape
    column = np.asarray(np.floor((x_m - centre_m[0]) / pixel_m[0] + columns / 2), np.int64)
    row = np.asarray(np.floor((centre_m[1] - z_m) / pixel_m[1] + rows / 2), np.int64)
    return row, column
