"""Pictures of single droplets, as PNG: a life, and the error of the integration."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from cldit.bench.droplet.convergence import Case, Convergence
from cldit.spray.droplet.follow import Life

_DPI = 130
_COLOURS = ("#1b6ca8", "#e07b00", "#b3202c", "#7a4fa3", "#2f8f4e")
_SHAPES = ("o", "s", "^", "v", "D")


def life_picture(life: Life, *, title: str) -> bytes:
    """PNG of d^2, temperature, speed and mass of the droplet `life` against time, below `title`."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    last = float(life.time_s[-1])
    scale, unit = next(((s, u) for s, u in ((1.0, "s"), (1e3, "ms")) if last * s >= 1), (1e6, "µs"))
    panels = (
        (life.diameter_m**2 * 1e12, "d² / µm²", True),
        (life.temperature_K, "temperature / K", False),
        (life.velocity_m_s, "velocity relative to the gas / (m/s)", False),
        (life.mass_kg / life.mass_kg[0], "mass / first mass", True),
    )
    for axes, (column, label, from_zero) in zip(
        figure.subplots(2, 2, sharex=True).flat, panels, strict=True
    ):
        axes.plot(life.time_s * scale, column, color=_COLOURS[0])
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.set_xlim(0, last * scale)
        if from_zero:
            axes.set_ylim(bottom=0)
    for axes in figure.axes[2:]:
        axes.set_xlabel(f"time / {unit}")
    return _png(figure)


def convergence_picture(
    found: Sequence[Convergence],
    euler: Mapping[Case, tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> bytes:
    """PNG of error against step size (left) and run time (right), one row a case.

    Args:
        found: of the integrator.
        euler: (N,) steps and (N,) errors of plain explicit steps, for comparison.
    """
    cases = list(dict.fromkeys(item.case for item in found))
    models = list(dict.fromkeys(item.model for item in found))
    figure = Figure(figsize=(11.0, 3.0 * len(cases) + 1.2), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(cases), 2, squeeze=False)
    for case, (left, right) in zip(cases, grid, strict=True):
        for item in (item for item in found if item.case == case):
            style = {
                "color": _COLOURS[models.index(item.model) % len(_COLOURS)],
                "marker": _SHAPES[models.index(item.model) % len(_SHAPES)],
                "markersize": 8 - 1.3 * models.index(item.model),  # none hides another
                "label": item.model,
                "alpha": 0.8,
            }
            left.loglog(item.step_s * 1e6, item.step_error, **style)
            order = np.argsort(item.adaptive_seconds)
            right.loglog(item.adaptive_seconds[order] * 1e6, item.adaptive_error[order], **style)
        if case in euler:
            steps, error = euler[case]
            left.loglog(steps * 1e6, error, "k--", label="explicit Euler, abramzon-sirignano")
        left.set_title(case.name, fontsize=10, loc="left")
        right.set_title("steps chosen by the integrator", fontsize=10, loc="left")
        left.set_xlabel("step / µs")
        right.set_xlabel("processor time / µs per droplet")
        right.axhline(1e-3, color="grey", linewidth=0.8)
        for axes in (left, right):
            axes.set_ylim(1e-7, 2.0)
            axes.set_ylabel("error")
            axes.grid(alpha=0.3)
            axes.xaxis.set_minor_formatter(NullFormatter())
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    figure.suptitle(
        "Error of lifetime and of the mass at half of it, against Radau (rtol 1e-7)\n"
        "left: fixed steps, the last ends where the droplet vanishes",
        fontsize=11,
    )
    return _png(figure)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI)
    return stream.getvalue()
