"""Figures of a study: maps and differences side by side, on a common scale."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cldit.run import Run
from cldit.show.figures.colours import CHANGE, Scale
from cldit.show.figures.maps import frame_of, map_legend, map_panel, reasons_in, spray_window
from cldit.show.figures.panels import GREY, ImageFrame, Panel, joined, panels_figure, window_around


def maps_sheet(runs: Mapping[str, Run], *, title: str, columns: int = 3) -> Figure:
    """Several maps of T_app in one scale, paler where the emissivity is low."""
    shown = {name: (run.maps, frame_of(run.scene)) for name, run in runs.items()}
    scale = Scale.of(maps for maps, _ in shown.values())
    window = joined([spray_window(*image) for image in shown.values()])
    panels = [
        map_panel(maps, scale, title=name, paper=False, frame=frame)
        for name, (maps, frame) in shown.items()
    ]
    reasons = set().union(*(reasons_in(*image, window) for image in shown.values()))
    legend = map_legend(reasons, scale, paper=False)
    return panels_figure(
        panels, title=title, window=window, columns=columns, shared=True, legend=legend
    )


def changes_sheet(
    changes: Mapping[str, NDArray[np.floating]],
    frame: ImageFrame,
    *,
    title: str,
    limit_K: float,
    columns: int = 3,
    label: str = "difference of apparent temperature /\N{NO-BREAK SPACE}K",
) -> Figure:
    """Differences (H, W) in one diverging scale, white at zero; NaN is grey."""
    window = joined([window_around(np.isfinite(image), frame) for image in changes.values()])
    panels = [
        Panel(image, name, label, (-limit_K, limit_K), CHANGE) for name, image in changes.items()
    ]
    legend = [(GREY, "not visible in both")]
    return panels_figure(
        panels, frame, title=title, window=window, columns=columns, shared=True, legend=legend
    )
