"""Figures of a study: maps and differences side by side, on a common scale."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from cldit.run import Run
from cldit.show.figures.colours import (
    UNKNOWN,
    emissivity_scale,
    map_colours,
    pixel_colours,
    temperature_range_K,
)
from cldit.show.figures.panels import Frame
from cldit.show.figures.sheet import figure_of, png_of

_COLUMNS = 3
_PANEL_IN = 3.3


@dataclass(frozen=True)
class Crop:
    """Part of an image that is shown, mm."""

    left: float = -45.0
    right: float = 45.0
    bottom: float = -75.0
    top: float = 6.0

    @property
    def aspect(self) -> float:
        """Height over width."""
        return (self.top - self.bottom) / (self.right - self.left)


def small_png(figure: Figure) -> bytes:
    """PNG of a figure in 255 colours."""
    return smaller(png_of(figure))


def smaller(png: bytes) -> bytes:
    """PNG in 255 colours, a third of the size."""
    with Image.open(io.BytesIO(png)) as image:
        plain = image.convert("RGB").quantize(255, Image.Quantize.MAXCOVERAGE, kmeans=3)
    stream = io.BytesIO()
    plain.save(stream, format="PNG", optimize=True)
    return stream.getvalue()


def frame_of(run: Run) -> Frame:
    """Axes of the images of a run."""
    x, _, z = run.scene.target_m
    return Frame(pixel_m=run.pixel_m, centre_m=(x, z))


def shared_scale(runs: Sequence[Run]) -> tuple[tuple[float, float], float]:
    """Range of temperature and largest emissivity of the common colour scale of several maps."""
    ranges = [temperature_range_K(run.maps) for run in runs]
    known = [each for each in ranges if each[1] > each[0]] or [(0.0, 0.0)]
    low, high = min(each[0] for each in known), max(each[1] for each in known)
    return (low, high), max(emissivity_scale(run.maps) for run in runs)


def _grid(
    titles: Sequence[str], crop: Crop, *, title: str, columns: int = _COLUMNS
) -> tuple[Figure, list[Axes]]:
    """Panels with shared axes in mm; only the outermost have labels."""
    columns = 2 if len(titles) == 4 else min(columns, len(titles))
    rows = -(-len(titles) // columns)
    height = _PANEL_IN * float(np.clip(crop.aspect, 0.3, 2.0))
    figure = figure_of(_PANEL_IN * columns + 1.5, (height + 0.3) * rows + 0.9)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for number, axes in enumerate(grid.ravel()):
        if number >= len(titles):
            axes.set_axis_off()
            continue
        axes.set_title(titles[number], fontsize=9)
        axes.set_aspect("equal")
        if number % columns == 0:
            axes.set_ylabel("z / mm")
        if number + columns >= len(titles):
            axes.set_xlabel("x / mm")
            axes.tick_params(labelbottom=True)
    figure.suptitle(title, fontsize=11)
    return figure, list(grid.ravel()[: len(titles)])


def _crop(axes: Axes, crop: Crop) -> None:
    axes.set_xlim(crop.left, crop.right)
    axes.set_ylim(crop.bottom, crop.top)
    axes.plot(0.0, 0.0, marker="v", markersize=5, color="black", markeredgecolor="white")


def maps_figure(
    runs: Mapping[str, Run], *, title: str, crop: Crop | None = None, columns: int = _COLUMNS
) -> bytes:
    """PNG of several DIT maps in one scale: hue = T_app, saturation = emissivity."""
    crop = crop or Crop()
    range_K, full = shared_scale(list(runs.values()))
    figure, panels = _grid(list(runs), crop, title=title, columns=columns)
    for axes, run in zip(panels, runs.values(), strict=True):
        shape = run.maps.emissivity.shape
        axes.imshow(
            pixel_colours(run.maps, range_K=range_K, scale=full),
            extent=frame_of(run).extent_mm(shape),
            interpolation="nearest",
        )
        _crop(axes, crop)
    _key(figure, panels, range_K, full)
    return small_png(figure)


def _key(figure: Figure, panels: list[Axes], range_K: tuple[float, float], full: float) -> None:
    """Draws the two-dimensional colour scale, right of the panels."""
    low, high = range_K
    if not high > low:
        return
    bar = figure.colorbar(ScalarMappable(), ax=panels, fraction=0.06, aspect=12, pad=0.02)
    key = bar.ax
    key.clear()
    warm, there = np.meshgrid(np.linspace(high, low, 200), np.linspace(0, full, 40))
    key.imshow(
        map_colours(there.T, warm.T, range_K=range_K, scale=full),
        extent=(0.0, full, low, high),
        aspect="auto",
    )
    key.set_ylabel("apparent temperature / K")
    key.yaxis.tick_right()
    key.yaxis.set_label_position("right")
    key.set_xlabel("emissivity", fontsize=8)
    key.set_xticks([0.0, full], ["0", f"{full:g}"], fontsize=8)


def changes_figure(
    changes: Mapping[str, NDArray[np.floating]],
    frame: Frame,
    *,
    title: str,
    limit_K: float,
    crop: Crop | None = None,
    columns: int = _COLUMNS,
    label: str = "difference of apparent temperature / K",
) -> bytes:
    """PNG of differences in one diverging scale, white at zero; NaN is grey."""
    crop = crop or Crop()
    figure, panels = _grid(list(changes), crop, title=title, columns=columns)
    norm = Normalize(-limit_K, limit_K)
    for axes, image in zip(panels, changes.values(), strict=True):
        axes.set_facecolor((UNKNOWN,) * 3)
        axes.imshow(
            np.ma.masked_invalid(image.astype(float)),
            extent=frame.extent_mm(image.shape),
            cmap="RdBu_r",
            norm=norm,
            interpolation="nearest",
        )
        _crop(axes, crop)
    figure.colorbar(
        ScalarMappable(norm, "RdBu_r"),
        ax=panels,
        label=label,
        fraction=0.06,
        pad=0.02,
        extend="both",
    )
    return small_png(figure)
