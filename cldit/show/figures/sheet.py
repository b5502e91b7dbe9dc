"""Figures, and places on them for images.

Images get places in inches, computed from their shape. A layout engine would find nearly the same
places by drawing everything twice and measuring every label, which took most of a report's time;
curves, whose labels differ, still use one (`figure_of`).
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_DPI = 130

# inches around an image: for the labels of z and x, and for the heading of a sheet
_LEFT, _BOTTOM, _TOP, _HEADING = 0.72, 0.52, 0.1, 0.4
_TITLE, _NOTE_LINE = 0.24, 0.16
_TALLEST = 3.0  # height of an image over the width available to it


@dataclass(frozen=True)
class Place:
    """Axes for an image and for its key (colour bar)."""

    image: Axes
    key: Axes


def plain(text: str) -> str:
    """User text for a figure, in which `$` starts no formula."""
    return text.replace("$", r"\$")


class Sheet(Figure):
    """Figure that a notebook shows, even if pyplot was never imported."""

    def _repr_png_(self) -> bytes:
        return png_of(self)


def figure_of(width_in: float, height_in: float) -> Figure:
    """Figure of `width_in` x `height_in` for curves; `png_of` crops it to its content."""
    figure = Sheet(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_of(figure: Figure) -> bytes:
    """PNG of a figure; with a layout engine, cropped to its content."""
    stream = io.BytesIO()
    if figure.get_layout_engine() is None:
        figure.savefig(stream, format="png", dpi=_DPI)
    else:
        figure.savefig(stream, format="png", dpi=_DPI, bbox_inches="tight", pad_inches=0.08)
    return stream.getvalue()


def sheet(
    titles: Sequence[str],
    *,
    aspect: float,
    heading: str,
    columns: int = 1,
    width_in: float = 4.7,
    gap_in: float = 0.1,
    key_in: float = 0.18,
    key_labels_in: float = 0.95,
    note: str = "",
) -> tuple[Figure, list[Place]]:
    """Figure with a titled place for each image, in rows under one heading, and a note below.

    Args:
        aspect: height over width of every image.
        columns: places in a row.
        width_in, gap_in, key_in, key_labels_in: widths in inches of an image, of the gap to its
            key, of the key, and of the key's labels.
    """
    wide = width_in if aspect <= _TALLEST else width_in * _TALLEST / aspect
    high = wide * aspect
    rows = -(-len(titles) // columns)
    each_wide = _LEFT + width_in + gap_in + key_in + key_labels_in
    each_high = _BOTTOM + high + _TOP + (_TITLE if any(titles) else 0.0)
    foot = _NOTE_LINE * (1 + note.count("\n")) if note else 0.0
    width, height = columns * each_wide, _HEADING + rows * each_high + foot
    figure = Sheet(figsize=(width, height), dpi=_DPI)
    FigureCanvasAgg(figure)
    figure.suptitle(plain(heading), y=1.0 - 0.5 * _HEADING / height, va="center", fontsize=11)
    if note:
        figure.text(0.5, 0.03 / height, note, ha="center", va="bottom", fontsize=7.5, color="0.25")
    places = []
    for number, title in enumerate(titles):
        left = (number % columns) * each_wide + _LEFT + 0.5 * (width_in - wide)
        bottom = foot + (rows - 1 - number // columns) * each_high + _BOTTOM
        image = figure.add_axes((left / width, bottom / height, wide / width, high / height))
        key = figure.add_axes(
            ((left + wide + gap_in) / width, bottom / height, key_in / width, high / height)
        )
        if title:
            # With a given height, matplotlib does not measure every label to find one.
            image.set_title(title, fontsize=9.5, y=1.0)
        places.append(Place(image, key))
    return figure, places
