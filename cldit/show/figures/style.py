"""The one style of all figures: size in print, fonts, formats.

A figure is drawn at its size on paper: two columns of a journal (174 mm) wide or less, text of
8 points. Files have 300 dpi, or are vectors.
"""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context, rcdefaults, rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from PIL import Image

from cldit.errors import FileError
from cldit.io.files import write_bytes

WIDTH_IN = 6.85
"""Two columns of a journal, 174 mm."""

DPI = 300
SCREEN_DPI = 150
SUFFIXES = (".png", ".pdf", ".svg")

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "figure.titlesize": 9.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.framealpha": 0.85,
    "axes.linewidth": 0.6,
    "axes.axisbelow": True,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.4,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "pdf.fonttype": 42,  # text that can be searched and edited
    "svg.hashsalt": "cldit",
}

_P = ParamSpec("_P")
_R = TypeVar("_R")


@contextmanager
def style() -> Iterator[None]:
    """Context in which matplotlib draws in this style, whatever the user's own."""
    with rc_context():
        rcdefaults()
        rcParams.update(_STYLE)
        yield


def styled(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Function that draws in this style."""

    @wraps(draw)
    def inside(*args: _P.args, **options: _P.kwargs) -> _R:
        with style():
            return draw(*args, **options)

    return inside


class Sheet(Figure):
    """Figure in this style, which a notebook shows even if pyplot was never imported."""

    @styled
    def draw(self, renderer: Any) -> None:
        """Draws everything; ticks are made only now."""
        super().draw(renderer)

    @styled
    def savefig(self, fname: Any, **options: Any) -> None:
        """Writes a file of 300 dpi; the options are matplotlib's."""
        super().savefig(fname, **{"dpi": DPI, **options})

    def _repr_png_(self) -> bytes:
        return png_of(self, dpi=SCREEN_DPI)


def figure_of(
    width_in: float, height_in: float, *, layout: Literal["constrained"] | None = "constrained"
) -> Figure:
    """Figure of `width_in` x `height_in`; without a layout, axes are placed by the caller."""
    figure = Sheet(figsize=(width_in, height_in), dpi=SCREEN_DPI, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def curves_of(
    width_in: float,
    height_in: float,
    *,
    title: str,
    rows: int = 1,
    columns: int = 1,
    **sharing: Any,
) -> tuple[Figure, Any]:
    """Figure for curves under a title, and its axes as `Figure.subplots` returns them."""
    figure = figure_of(width_in, height_in)
    axes = figure.subplots(rows, columns, **sharing)
    figure.suptitle(plain(title))
    return figure, axes


def finish(axes: Axes, x: str, y: str, *, minor: bool = False, legend: bool = False) -> None:
    """Labels of the axes, lines at the ticks, at the minor ones too with `minor`, and a legend."""
    axes.set(xlabel=x, ylabel=y)
    axes.grid(which="both" if minor else "major")
    if legend:
        axes.legend()


def plain(label: str) -> str:
    """User text for a figure, in which `$` starts no formula."""
    return label.replace("$", r"\$")


def plain_ticks(axes: Axes) -> None:
    """Writes ticks of logarithmic axes as 0.2, 0.5, 1: powers of ten are read less easily."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())


def png_of(figure: Figure, *, dpi: int = DPI) -> bytes:
    """PNG of a figure."""
    figure.set_dpi(dpi)
    canvas: Any = figure.canvas
    canvas.draw()
    stream = io.BytesIO()
    # without matplotlib's writer: no alpha, and a third of its time
    image = Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    image.save(stream, format="PNG", dpi=(dpi, dpi), compress_level=4)
    return stream.getvalue()


def figure_bytes(figure: Figure, suffix: str) -> bytes:
    """File of a figure of a kind: .png, .pdf or .svg."""
    if suffix == ".png":
        return png_of(figure)
    stream = io.BytesIO()
    date = {".pdf": "CreationDate", ".svg": "Date"}[suffix]
    figure.savefig(stream, format=suffix[1:], metadata={date: None})
    return stream.getvalue()


def write_figure(figure: Figure, path: Path) -> Path:
    """Writes a figure as PNG, PDF or SVG, by the suffix of `path`; returns the path."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(f"{path}: figures end in {path.suffix!r}; allowed: {', '.join(SUFFIXES)}")
    write_bytes(path, figure_bytes(figure, suffix))
    return path
