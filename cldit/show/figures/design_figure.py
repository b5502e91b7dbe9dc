"""Error of the apparent temperature against the time that a measurement takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cldit.dit.design import Design, Goal
from cldit.show.figures.sheet import figure_of, png_of

Floats = NDArray[np.float64]


def design_picture(
    lines: Sequence[tuple[Design, Floats, Floats]], best: Design, goal: Goal, *, title: str
) -> bytes:
    """PNG of a line for each number of backgrounds, its shots varied; the chosen design is marked.

    Args:
        lines: design, (N,) times [s], (N,) errors [K].
        best: the chosen design.
        goal: error that is wanted.
        title: above the picture.
    """
    figure = figure_of(7.4, 4.6)
    axes = figure.subplots()
    for design, time_s, error_K in sorted(lines, key=lambda line: len(line[0].backgrounds_K)):
        low, high = min(design.backgrounds_K), max(design.backgrounds_K)
        label = f"{len(design.backgrounds_K)} backgrounds, {low:g} to {high:g} K"
        (drawn,) = axes.loglog(time_s / 60.0, error_K, label=label, linewidth=1.4)
        axes.plot(design.time_s / 60.0, design.error_K, "o", color=drawn.get_color(), markersize=4)
    axes.plot(
        best.time_s / 60.0,
        best.error_K,
        "o",
        markersize=11,
        markerfacecolor="none",
        markeredgecolor="black",
        label=f"plan.yaml: {best.shots} shots, {best.references} references each",
    )
    axes.axhline(goal.error_K, color="grey", linewidth=0.8, linestyle="--")
    axes.annotate(
        "wanted",
        (1.0, goal.error_K),
        xycoords=("axes fraction", "data"),
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color="grey",
    )
    axes.set_xlabel("time / min")
    axes.set_ylabel(f"standard error of T_app / K, {100 * goal.quantile:g} % quantile")
    axes.set_title(title.replace("$", r"\$"), fontsize=10)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(lambda value, _: "")
    axes.set_yticks([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50])
    lowest = min(float(errors.min()) for _, _, errors in lines)
    highest = max(float(errors.max()) for _, _, errors in lines)
    axes.set_ylim(0.8 * lowest, 1.2 * max(highest, goal.error_K))
    axes.set_xticks([20, 30, 40, 60, 100, 200, 400, 1000])
    longest = max(float(time_s[-1]) for _, time_s, _ in lines) / 60.0
    shortest = min(float(time_s[0]) for _, time_s, _ in lines) / 60.0
    axes.set_xlim(0.9 * shortest, 1.1 * longest)
    axes.grid(which="both", alpha=0.25)
    axes.legend(fontsize=8)
    return png_of(figure)
