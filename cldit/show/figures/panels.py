"""Images of numbers with axes in mm and a colour bar each; injector tip at (0, 0)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from cldit.show.figures.colours import UNKNOWN
from cldit.show.figures.sheet import Place, png_of, sheet

_GREY = (UNKNOWN, UNKNOWN, UNKNOWN)


@dataclass(frozen=True)
class Frame:
    """Position of an image: size of its pixels on the object, and (x, z) of its centre."""

    pixel_m: tuple[float, float]
    centre_m: tuple[float, float] = (0.0, 0.0)

    def extent_mm(self, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
        """Left, right, bottom, top of an image of (H, W) pixels."""
        half_x, half_z = 500.0 * self.pixel_m[0] * shape[1], 500.0 * self.pixel_m[1] * shape[0]
        x, z = (1e3 * middle for middle in self.centre_m)
        return x - half_x, x + half_x, z - half_z, z + half_z


@dataclass(frozen=True)
class Panel:
    """Image of numbers (H, W), NaN shown grey.

    limits: ends of the colour scale; None: all but the outermost thousandths.
    """

    image: NDArray[np.generic]
    title: str
    label: str
    limits: tuple[float, float] | None = None
    colours: str = "inferno"
    logarithmic: bool = False


def axes_mm(axes: Axes, frame: Frame, shape: tuple[int, ...]) -> None:
    """Labels the axes of an image of `shape` (H, W) and marks the injector's tip inside it."""
    left, right, bottom, top = frame.extent_mm(shape)
    axes.set_xlabel("x / mm")
    axes.set_ylabel("z / mm")
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    if left <= 0.0 <= right and bottom <= 0.0 <= top:
        axes.plot(0.0, 0.0, marker="v", markersize=8, color="black", markeredgecolor="white")
        axes.annotate(
            "injector",
            (0.0, 0.0),
            xytext=(8, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color="black",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "lw": 0},
        )


def aspect_of(frame: Frame, shape: tuple[int, ...]) -> float:
    """Height over width, in `frame`, of an image of `shape` (H, W) pixels."""
    left, right, bottom, top = frame.extent_mm(shape)
    return (top - bottom) / (right - left)


def panels_png(panels: Sequence[Panel], frame: Frame, *, title: str) -> bytes:
    """PNG of `panels_figure` of `panels` in `frame` under a `title`."""
    return png_of(panels_figure(panels, frame, title=title))


def panels_figure(panels: Sequence[Panel], frame: Frame, *, title: str) -> Figure:
    """Figure of `panels` in `frame` under a `title`, at most two side by side."""
    columns = min(2, len(panels))
    figure, places = sheet(
        [panel.title for panel in panels],
        aspect=aspect_of(frame, panels[0].image.shape),
        heading=title,
        columns=columns,
        width_in=4.7 if columns == 1 else 3.6,
    )
    for place, panel in zip(places, panels, strict=True):
        values = panel.image.astype(np.float64)
        low, high = panel.limits or robust_limits(values)
        norm = LogNorm(low, high) if panel.logarithmic else Normalize(low, high)
        drawn = draw(place, values, frame, norm=norm, colours=panel.colours)
        draw_key(place, drawn, panel.label, below=np.any(values < low), above=np.any(values > high))
    return figure


def draw(
    place: Place, values: NDArray[np.float64], frame: Frame, *, norm: Normalize, colours: str
) -> AxesImage:
    """Draws `values` (H, W) and their axes, NaN grey, with matplotlib's colour map `colours`."""
    place.image.set_facecolor(_GREY)
    drawn = place.image.imshow(
        np.ma.masked_invalid(values),
        extent=frame.extent_mm(values.shape),
        cmap=colours,
        norm=norm,
        interpolation="nearest",
        aspect="auto",
    )
    axes_mm(place.image, frame, values.shape)
    return drawn


def draw_key(
    place: Place, drawn: AxesImage, label: str, *, below: bool | np.bool_, above: bool | np.bool_
) -> None:
    """Draws the colour bar of an image; an end beyond which values lie is pointed."""
    names = {(True, True): "both", (True, False): "min", (False, True): "max"}
    extend = names.get((bool(below), bool(above)), "neither")
    place.image.figure.colorbar(drawn, cax=place.key, label=label, extend=extend)


def robust_limits(values: NDArray[np.floating], *, cut: float = 0.1) -> tuple[float, float]:
    """Percentiles `cut` and 100 - `cut` of the finite `values`; never an empty interval."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = (float(at) for at in np.percentile(known, [cut, 100.0 - cut]))
    return (low, high) if high > low else (low, low + max(1.0, abs(low)) * 1e-6)
