"""The error of the integration of single droplets, as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.ticker import NullFormatter

from cldit.show.figures.sheet import figure_of, png_of
from cldit.spray.droplet.curves import Floats
from tests.verify.droplet_convergence import Case, Convergence

_COLOURS = ("#1b6ca8", "#e07b00", "#b3202c", "#7a4fa3", "#2f8f4e")
_SHAPES = ("o", "s", "^", "v", "D")


def convergence_picture(
    found: Sequence[Convergence],
    euler: Mapping[Case, tuple[Floats, Floats]],
) -> bytes:
    """PNG of error against step size (left) and run time (right), one row a case.

    Args:
        found: of the integrator.
        euler: (N,) steps and (N,) errors of plain explicit steps, for comparison.
    """
    cases = list(dict.fromkeys(item.case for item in found))
    models = list(dict.fromkeys(item.model for item in found))
    figure = figure_of(11.0, 3.0 * len(cases) + 1.2)
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
    return png_of(figure)
