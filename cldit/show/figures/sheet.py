"""Figures and the places of pictures on them.

Pictures of pixels get places in inches, worked out from their shape. A layout engine would find
much the same by drawing everything twice and measuring every label, which was most of a report's
time; curves, whose labels differ, still use one (`figure_of`).
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_DPI = 130

# inches around a picture: for the labels of z and x, and for the heading of a sheet
_LEFT, _BOTTOM, _TOP, _HEADING = 0.72, 0.52, 0.1, 0.4
_TITLE, _NOTE_LINE = 0.24, 0.16
_TALLEST = 3.0  # times the width that a picture may take


@dataclass(frozen=True)
class Place:
    """Axes for a picture and for its key (colour bar)."""

    picture: Axes
    key: Axes


def plain(text: str) -> str:
    """User text for a figure: `$` would start a formula."""
    return text.replace("$", r"\$")


class Sheet(Figure):
    """A figure that a notebook shows, also where nobody has loaded pyplot."""

    def _repr_png_(self) -> bytes:
        return png_of(self)


def figure_of(width_in: float, height_in: float) -> Figure:
    """A figure of `width_in` x `height_in` for curves; `png_of` crops it to what is drawn."""
    figure = Sheet(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_of(figure: Figure) -> bytes:
    """The figure as PNG; one with a layout engine is cropped to what is drawn."""
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
    """A figure with places for pictures, in rows, under one heading.

    Args:
        titles: of the places.
        aspect: height over width of every picture.
        heading: of the figure.
        columns: places in a row.
        width_in, gap_in, key_in, key_labels_in: widths in inches of a picture, of the gap to its
            key, of the key, and of the key's labels.
        note: small print below everything.

    Returns:
        The figure and its places.
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
        picture = figure.add_axes((left / width, bottom / height, wide / width, high / height))
        key = figure.add_axes(
            ((left + wide + gap_in) / width, bottom / height, key_in / width, high / height)
        )
        if title:
            # A height that is given keeps matplotlib from measuring every label to find one.
            picture.set_title(title, fontsize=9.5, y=1.0)
        places.append(Place(picture, key))
    return figure, places
