"""A curve over time as SVG paths, for a page that is drawn every few seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.ticker import MaxNLocator

WIDTH, HEIGHT = 560.0, 200.0  # of the plane within its axes, in the drawing's units


@dataclass(frozen=True)
class Plot:
    """Paths (SVG's `d`) in the plane, and ticks: place and label.

    band: upper edge and height of the tolerance, where there is one.
    """

    line: str
    target: str
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]
    band: tuple[float, float] | None
    last: tuple[float, float]
    width: float = WIDTH
    height: float = HEIGHT


def curve(
    x: Sequence[float],
    y: Sequence[float],
    *,
    target: Sequence[float],
    band: tuple[float, float] | None = None,
    most: float | None = None,
) -> Plot:
    """A curve and where it is to go.

    Args:
        x, y: of the curve, one point or more.
        target: of every point; drawn in steps.
        band: lower and upper end of what is allowed.
        most: y is cut at this distance from 0, so that a far beginning does not flatten the end.
    """
    shown = np.asarray(y, np.float64)
    if most is not None:
        shown = np.clip(shown, -most, most)
    goal = np.asarray(target, np.float64)
    ends = np.concatenate([shown, goal, np.asarray(band if band is not None else (), np.float64)])
    low, high = float(ends.min()), float(ends.max())
    margin = 0.06 * (high - low) or 1.0
    low, high = low - margin, high + margin
    first, last = float(min(x)), float(max(x))
    span = (last - first) or 1.0

    def across(value: float) -> float:
        return round(WIDTH * (value - first) / span, 1)

    def down(value: float) -> float:
        return round(HEIGHT * (high - value) / (high - low), 1)

    def ticks(begin: float, end: float, place: str) -> tuple[tuple[float, str], ...]:
        inside = [v for v in MaxNLocator(6).tick_values(begin, end) if begin <= v <= end]
        return tuple(((across if place == "x" else down)(v), f"{v + 0.0:.10g}") for v in inside)

    points = [(across(a), down(b)) for a, b in zip(x, shown.tolist(), strict=True)]
    steps = [(across(a), down(b)) for a, b in zip(x, goal.tolist(), strict=True)]
    return Plot(
        line="M" + " L".join(f"{a:g} {b:g}" for a, b in points),
        target=f"M{steps[0][0]:g} {steps[0][1]:g}" + "".join(f" V{b:g} H{a:g}" for a, b in steps),
        x_ticks=ticks(first, first + span, "x"),
        y_ticks=ticks(low, high, "y"),
        band=None if band is None else (down(band[1]), down(band[0]) - down(band[1])),
        last=points[-1],
    )
