"""Panels: images of numbers with axes in mm and colour bars; injector tip at (0, 0).

Panels get places in inches, computed from their shape. A layout engine would find nearly the same
places by drawing everything twice and measuring every label, which took most of a report's time;
curves, whose labels differ, still use one (`style.figure_of`).
"""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator
from numpy.typing import NDArray

from cldit.show.figures.colours import UNKNOWN, robust_limits
from cldit.show.figures.style import WIDTH_IN, figure_of, plain, styled

GREY = (UNKNOWN, UNKNOWN, UNKNOWN)
Window = tuple[float, float, float, float]
"""Left, right, bottom, top in mm."""

_IN = SimpleNamespace(  # inches
    left=0.52, bottom=0.4, edge=0.06,  # labels of z and x, and the other edges
    gap=0.14, key_gap=0.06, key=0.1, key_labels=0.56,  # between columns; colour bar and its labels
    heading=0.28, letter=0.24,  # the title, and (a) before that of a panel
    line=1.3 * 8 / 72, character=0.6 * 8 / 72,  # a line, and the mean width, of 8 points
    high=7.6, widest=4.2,  # all rows, and a single panel
)  # fmt: skip
_STEPS = (1, 2, 5, 10)  # of ticks


@dataclass(frozen=True)
class ImageFrame:
    """Position of an image: size of its pixels on the object, and (x, z) of its centre.

    axes: names of the coordinates to the right and upwards.
    """

    pixel_m: tuple[float, float]
    centre_m: tuple[float, float] = (0.0, 0.0)
    axes: tuple[str, str] = ("x", "z")

    def extent_mm(self, shape: tuple[int, ...]) -> Window:
        """Left, right, bottom, top of an image of (H, W) pixels."""
        half_x, half_z = 500.0 * self.pixel_m[0] * shape[1], 500.0 * self.pixel_m[1] * shape[0]
        x, z = (1e3 * middle for middle in self.centre_m)
        return x - half_x, x + half_x, z - half_z, z + half_z

    def slices(self, shape: tuple[int, ...], window: Window) -> tuple[slice, slice]:
        """Rows and columns, of an image of (H, W) pixels, in a window."""
        left, _, _, top = self.extent_mm(shape)
        wide, high = (1e3 * size for size in self.pixel_m)
        columns = _inside((window[0] - left) / wide, (window[1] - left) / wide)
        return _inside((top - window[3]) / high, (top - window[2]) / high), columns


@dataclass(frozen=True)
class Panel:
    """Image of numbers (H, W). Pixels without one are grey; white where `clear` is True.

    limits: ends of the colour scale; None: all but the outermost thousandths. opacity: (H, W), 0 to
    1, over white. frame, window: of this image, if they are not those of the figure. stamp: text in
    a corner.
    """

    image: NDArray[np.generic]
    title: str
    label: str
    limits: tuple[float, float] | None = None
    colours: str | Colormap = "inferno"
    logarithmic: bool = False
    opacity: NDArray[np.floating] | None = None
    clear: NDArray[np.bool_] | None = None
    frame: ImageFrame | None = None
    window: Window | None = None
    stamp: str = ""


def window_around(weight: NDArray[np.floating], frame: ImageFrame) -> Window:
    """Part of an image with all but 0.1 % of `weight` (H, W) on each side, and the injector's tip.

    With a margin, in round numbers, at least half as wide as high and the reverse; the whole image
    without any weight.
    """
    extent = frame.extent_mm(weight.shape)
    positive = np.maximum(np.nan_to_num(np.asarray(weight, np.float64)), 0.0)
    if not positive.any():
        return extent
    left, right, bottom, top = extent
    spans = []
    sums = (positive.sum(axis=0), left, right), (positive.sum(axis=1), top, bottom)
    for along, start, end in sums:
        edges = np.linspace(start, end, along.size + 1)
        share = np.cumsum(along) / along.sum()
        ends = [edges[np.searchsorted(share, 1e-3)], edges[np.searchsorted(share, 0.999) + 1]]
        if min(start, end) <= 0.0 <= max(start, end):
            ends.append(0.0)
        spans.append((min(ends), max(ends)))
    size = max(high - low for low, high in spans)
    ends_mm: list[float] = []
    for (low, high), limits in zip(spans, ((left, right), (bottom, top)), strict=True):
        beside = max(0.06 * size, 0.25 * size - 0.5 * (high - low))
        step = 10.0 ** math.floor(math.log10(size)) / 2.0
        ends_mm += [
            max(limits[0], step * math.floor((low - beside) / step)),
            min(limits[1], step * math.ceil((high + beside) / step)),
        ]
    return ends_mm[0], ends_mm[1], ends_mm[2], ends_mm[3]


def joined(windows: Sequence[Window]) -> Window:
    """Smallest window that includes all of them."""
    edges = np.array(windows).T
    return float(min(edges[0])), float(max(edges[1])), float(min(edges[2])), float(max(edges[3]))


@styled
def panels_figure(
    panels: Sequence[Panel],
    frame: ImageFrame | None = None,
    *,
    title: str,
    window: Window | None = None,
    columns: int = 2,
    shared: bool = False,
    legend: Sequence[tuple[Any, str]] = (),
) -> Figure:
    """Figure of `panels` under a `title`, in rows.

    Args:
        frame: of panels without their own.
        window: part to show of panels without their own; None: the whole images.
        columns: largest number of panels side by side.
        shared: one colour bar for all, that of the first panel.
        legend: colours and what they mean, below the panels.
    """
    panels = [_cut(panel, frame, window) for panel in panels]
    layout = _Layout(panels, title, columns, shared, [meaning for _, meaning in legend])
    figure = figure_of(layout.width, layout.height, layout=None)
    if title:
        middle = 1.0 - (0.5 * layout.head - 0.03) / layout.height
        figure.suptitle(layout.heading, y=middle, va="center")
    letter = layout.letter
    for number, panel in enumerate(panels):
        leftmost = number % layout.columns == 0
        place = layout.place(number)
        axes = figure.add_axes(layout.shares(*place))
        _draw(axes, panel)
        _label(axes, panel, leftmost=leftmost, lowest=layout.labelled[number])
        for label, right, weight in ((f"({chr(97 + number)})", 0.0, "bold"),
                                    (layout.titles[number], letter, "normal")):  # fmt: skip
            if letter or weight == "normal":
                axes.annotate(label, (right / layout.wide, 1.0), (0, 3), "axes fraction",
                              "offset points", weight=weight, va="bottom")  # fmt: skip
        left, right, bottom, top = layout.windows[number]
        if number == 0 and left < 0 < right and bottom < 0 < top - 0.07 * (top - bottom):
            axes.annotate("injector", (0, 0), (5, 2), textcoords="offset points", fontsize=7,
                          path_effects=[withStroke(linewidth=2, foreground="white")])  # fmt: skip
        if not shared:
            x, at, wide, high = place
            _key(figure.add_axes(layout.shares(x + wide + _IN.key_gap, at, _IN.key, high)), [panel])
    if shared:
        _key(figure.add_axes(layout.shares(*layout.shared_key)), panels)
    if legend:
        handles = [Patch(facecolor=colour, edgecolor="0.4", linewidth=0.5) for colour, _ in legend]
        ncols = len(legend) if layout.side_by_side else 1
        figure.legend(handles, layout.lines, loc="lower center", frameon=False, borderpad=0.1,
                      labelspacing=0.3, ncols=ncols)  # fmt: skip
    return figure


class _Layout:
    """Places of panels in rows, titles and legend, in inches from the upper left corner."""

    def __init__(
        self, panels: Sequence[Panel], title: str, columns: int, shared: bool, meanings: list[str]
    ) -> None:
        count = len(panels)
        self.windows = [panel.window or (0.0, 1.0, 0.0, 1.0) for panel in panels]
        self.columns = columns = 2 if count == 4 and columns > 1 else min(columns, count)
        rows = -(-count // columns)
        beside = _IN.key_gap + _IN.key + _IN.key_labels
        lost = _IN.left + _IN.edge + (columns - 1) * _IN.gap + (1 if shared else columns) * beside
        self.aspects = [(edges[3] - edges[2]) / (edges[1] - edges[0]) for edges in self.windows]
        in_row = [slice(row * columns, (row + 1) * columns) for row in range(rows)]
        self.tall = [max(self.aspects[of_row]) for of_row in in_row]
        self.wide = wide = min((WIDTH_IN - lost) / columns, _IN.widest, _IN.high / sum(self.tall))
        self.letter = _IN.letter if count > 1 else 0.0
        self.titles = [_wrapped(plain(panel.title), wide - self.letter) for panel in panels]
        above = 0.05 + _IN.line * max(name.count("\n") + 1 if name else 0 for name in self.titles)
        self.width = width = max(lost + columns * wide, 0.5 * WIDTH_IN)
        self.lines = [_wrapped(plain(meaning), width - 0.6) for meaning in meanings]
        self.side_by_side = sum(0.5 + _IN.character * len(meaning) for meaning in meanings) < width
        high_lines = 1 if self.side_by_side else sum(line.count("\n") + 1 for line in self.lines)
        self.labelled = [
            number + columns >= count or self.windows[number + columns] != self.windows[number]
            for number in range(count)
        ]
        self.heading = _wrapped(plain(title), width - 0.4)
        self.head = at = _IN.heading + _IN.line * self.heading.count("\n") if title else 0.0
        self.tops: list[float] = []  # of the rows
        for high, of_row in zip(self.tall, in_row, strict=True):
            self.tops.append(at + above)
            at = self.tops[-1] + high * wide + (_IN.bottom if any(self.labelled[of_row]) else 0.06)
        self.height = at + (_IN.line * high_lines + 0.06 if meanings else 0.0)
        self._start = 0.5 * (width - lost - columns * wide) + _IN.left
        self._step = wide + _IN.gap + (0.0 if shared else beside)

    def place(self, number: int) -> tuple[float, float, float, float]:
        """Left, top, width and height of the panel `number`."""
        row, column = divmod(number, self.columns)
        high = self.aspects[number] * self.wide
        return self._start + column * self._step, self.tops[row], self.wide, high

    @property
    def shared_key(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of one colour bar beside the first two rows."""
        row = min(len(self.tops), 2) - 1
        x = self._start + self.columns * self.wide + (self.columns - 1) * _IN.gap + _IN.key_gap
        return x, self.tops[0], _IN.key, self.tops[row] + self.tall[row] * self.wide - self.tops[0]

    def shares(
        self, x: float, top: float, wide: float, high: float
    ) -> tuple[float, float, float, float]:
        """The place as shares of the figure, from its lower left corner."""
        bottom = 1.0 - (top + high) / self.height
        return x / self.width, bottom, wide / self.width, high / self.height


def _cut(panel: Panel, frame: ImageFrame | None, window: Window | None) -> Panel:
    """The panel's pixels in its window, with their frame."""
    frame = panel.frame or frame or ImageFrame((1e-3, 1e-3))
    window = panel.window or window or frame.extent_mm(panel.image.shape)
    rows, columns = part = frame.slices(panel.image.shape, window)
    image = panel.image[part]
    left, _, _, top = frame.extent_mm(panel.image.shape)
    x = 1e-3 * left + frame.pixel_m[0] * (columns.start + 0.5 * image.shape[1])
    z = 1e-3 * top - frame.pixel_m[1] * (rows.start + 0.5 * image.shape[0])
    return replace(
        panel,
        image=image,
        limits=panel.limits or robust_limits(image.astype(np.float64)),
        opacity=None if panel.opacity is None else panel.opacity[part],
        clear=None if panel.clear is None else panel.clear[part],
        frame=replace(frame, centre_m=(x, z)),
        window=window,
    )


def _inside(start: float, end: float) -> slice:
    return slice(max(0, math.floor(start + 1e-6)), max(1, math.ceil(end - 1e-6)))


def _wrapped(label: str, width_in: float) -> str:
    """Lines of about the same length, as few as fit into the width: no last line of one word."""
    widest = max(8, int(width_in / _IN.character))
    lines = textwrap.wrap(label, widest)
    even = (textwrap.wrap(label, width) for width in range(8, widest))
    return "\n".join(next((split for split in even if len(split) == len(lines)), lines))


def _norm(panel: Panel) -> Normalize:
    assert panel.limits is not None
    return LogNorm(*panel.limits) if panel.logarithmic else Normalize(*panel.limits)


def _draw(axes: Axes, panel: Panel) -> None:
    values = panel.image.astype(np.float64)
    assert panel.frame is not None and panel.window is not None
    extent = panel.frame.extent_mm(values.shape)
    unknown = ~np.isfinite(values)
    if panel.clear is not None:
        unknown &= ~panel.clear
    if unknown.any():
        shade = np.ones((*unknown.shape, 3))
        shade[unknown] = GREY
        axes.imshow(shade, extent=extent, interpolation="nearest", aspect="auto")
    axes.imshow(
        np.ma.masked_invalid(values),
        extent=extent,
        cmap=panel.colours,
        norm=_norm(panel),
        alpha=panel.opacity,
        interpolation="nearest",
        aspect="auto",
    )
    axes.plot(0.0, 0.0, marker="v", markersize=5, color="black", mec="white", mew=0.6)
    if panel.stamp:
        axes.text(0.03, 0.97, plain(panel.stamp), transform=axes.transAxes, va="top",
                  family="monospace", weight="bold",
                  bbox={"facecolor": "white", "alpha": 0.85, "lw": 0, "pad": 1.5})  # fmt: skip


def _label(axes: Axes, panel: Panel, *, leftmost: bool, lowest: bool) -> None:
    assert panel.frame is not None and panel.window is not None
    left, right, bottom, top = panel.window
    axes.set(xlim=(left, right), ylim=(bottom, top))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=_STEPS))
    axes.set_xticks([tick for tick in axes.get_xticks() if left <= tick <= right])
    for tick, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True):
        if tick in (left, right):  # beside the label of the next panel
            label.set_horizontalalignment("left" if tick == left else "right")
    axes.tick_params(labelleft=leftmost, labelbottom=lowest)
    if leftmost:
        axes.set_ylabel(f"{panel.frame.axes[1]} / mm")
    if lowest:
        axes.set_xlabel(f"{panel.frame.axes[0]} / mm")


def beyond(limits: tuple[float, float], *shown: NDArray[np.generic]) -> str:
    """Ends of a colour bar that get an arrow: values are beyond them, by more than rounding."""
    low, high = limits
    rounding = 1e-5 * (high - low)
    values = [np.asarray(image, np.float64) for image in shown]
    below = any(bool(np.any(image < low - rounding)) for image in values)
    above = any(bool(np.any(image > high + rounding)) for image in values)
    return {(True, True): "both", (True, False): "min", (False, True): "max"}.get(
        (below, above), "neither"
    )


def _key(axes: Axes, panels: Sequence[Panel]) -> None:
    """Draws a colour bar; an end beyond which values lie is pointed."""
    if not any(np.isfinite(panel.image.astype(np.float64)).any() for panel in panels):
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no value", rotation=90, ha="center", va="center")
        return
    low, high = limits = panels[0].limits or (0.0, 1.0)
    panel, size = panels[0], max(abs(low), abs(high))
    power = 0 if panel.logarithmic or 1e-2 <= size < 1e4 else math.floor(math.log10(size or 1.0))
    unit = rf"$10^{{{power}}}$ {panel.label}" if power else panel.label
    bar = axes.figure.colorbar(
        ScalarMappable(_norm(panel), panel.colours),
        cax=axes,
        extend=beyond(limits, *(panel.image for panel in panels)),
        extendfrac=0.04,
    )
    high_in = axes.get_window_extent().height / axes.figure.dpi
    if panel.logarithmic:
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.minorticks_off()
    else:
        count = max(2, min(6, int(high_in / 0.3)))
        bar.ax.yaxis.set_major_locator(MaxNLocator(count, steps=_STEPS))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 10**power:.4g}"))
    bar.set_label(unit if power else _wrapped(unit, high_in))
