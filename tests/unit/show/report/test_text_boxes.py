"""No text of any figure is cut, or covers another text or another panel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.axes._base import _AxesBase
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from cldit.bench.budget import BudgetRow, budget_figure
from cldit.dit.design import Design, Goal
from cldit.gpu.device import open_device
from cldit.prepare.spray_factory import make_spray
from cldit.run import open_run
from cldit.scene import load_scene
from cldit.scene.spray import ConeSpray
from cldit.show.figures import curves
from cldit.show.figures.maps import camera_figures, frame_of, map_figure
from cldit.show.figures.optics_figures import optics_figure
from cldit.show.figures.panels import Panel, panels_figure
from cldit.show.figures.style import figure_of, png_of, style
from cldit.show.report import series_report
from cldit.show.report.optics_summary import scene_optics
from cldit.show.report.spray_report import history_figure, views_figure
from cldit.spray.droplet.follow import Life
from cldit.spray.flow.measures import History
from tests.bench.error import Row, error_figure
from tests.unit.show.report.test_film import times

WRITTEN = Path(__file__).parents[3] / "data" / "run-0.1.0"
_SLACK = 1.0  # pixels of 150 dpi: a sixth of a millimetre, by which boxes exceed their ink


Written = tuple[str, _AxesBase | None, Bbox]


def drawn(figure: Figure, monkeypatch: pytest.MonkeyPatch) -> list[Written]:
    """Texts that the renderer draws, with their axes and boxes."""
    found: list[Written] = []
    draw = Text.draw

    def recorded(self: Text, renderer: Any) -> None:
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            found.append((self.get_text(), self.axes, self.get_window_extent(renderer)))

    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", recorded)
        png_of(figure, dpi=150)
    return found


def faults(figure: Figure, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Texts that are cut at the figure's edge, and those that cover something."""
    texts = drawn(figure, monkeypatch)
    assert texts
    whole = figure.bbox
    said = []
    for text, axes, box in texts:
        if not (box.x0 >= whole.x0 - _SLACK and box.x1 <= whole.x1 + _SLACK
                and box.y0 >= whole.y0 - _SLACK and box.y1 <= whole.y1 + _SLACK):  # fmt: skip
            said.append(f"{text!r} is cut")
        for other in figure.axes:
            mine = axes is None or other is axes
            if not mine and not _twins(axes, other) and _cover(box, other.get_window_extent()):
                said.append(f"{text!r} lies on another panel")
    said += [
        f"{one[0]!r} on {other[0]!r}"
        for one, other in combinations(texts, 2)
        if _cover(one[2], other[2])
    ]
    return said


def _twins(one: _AxesBase | None, other: Axes) -> bool:
    return one is not None and bool(
        one.get_window_extent().bounds == other.get_window_extent().bounds
    )


def _cover(one: Bbox, other: Bbox) -> bool:
    both = Bbox.intersection(one, other)
    return both is not None and min(both.width, both.height) > _SLACK


def kinds(tables: Path) -> Iterator[tuple[str, Figure]]:
    """One figure of every kind, with long names and crowded points."""
    run = open_run(WRITTEN)
    for what in ("maps", "acquired", "summary", "errors", "weights", "spectrum", "profile"):
        yield f"run: {what}", run.plot(what)
    yield "run: paper", run.plot("maps", paper=True)
    frame, shape = frame_of(run.scene), run.maps.emissivity.shape
    whole = frame.extent_mm(shape)
    yield "run: whole", map_figure(run.maps, frame, title="whole " * 9, window=whole, stamp="1 ms")
    yield "camera", camera_figures({400.0: 1e4 * run.maps.emissivity}, frame, title="old")[400.0]
    long = "temperature of the black body's surface, 0.5 K between points of its calibration"
    image = np.full(shape, 1e-19)
    panels = [Panel(image * at, long, "photons / (s m² sr)") for at in range(1, 7)]
    for number in (1, 3, 4, 6):
        yield f"{number} panels", panels_figure(panels[:number], frame, title="t")
        shared = panels_figure(
            panels[:number], frame, title="t", columns=3, shared=True, window=(-5, 5, -30, 9),
            legend=[("0.8", long), ("white", long), ("white", "transparent")],
        )  # fmt: skip
        yield f"{number} panels with one key", shared
    yield "spray", views_figure(make_spray(ConeSpray(), open_device()), title="spray")
    steps = np.linspace(1e-4, 1e-3, 9)
    yield "history", history_figure(History(*[steps] * len(fields(History))), title="flow")
    yield "series", series_report.curves(*times(), title="a series")
    kelvin = {long: 0.95, "cells": None, "rays": 1.0}
    yield "budget", curves.budget_figure(kelvin, title="error of T_app", total_K=1.0)
    yield "wavelengths", curves.nodes_figure([3.0, 0.5, 0.01], chosen=2, title="wavelengths")
    yield "life", curves.life_figure(Life(*[steps] * 5), title="one droplet")
    design = Design(
        backgrounds_K=(413.0, 488.0, 563.0), shots=9, references=9, integration_time_s=2e-5,
        error_K=2.0, emissivity_error=0.01, time_s=1e3, waiting_s=2e2,
    )  # fmt: skip
    lines = [(design, np.array([6e2, 6e3]), np.array([4.0, 0.5]))]
    yield "design", curves.design_figure(lines, design, Goal(error_K=2.0), title="against time")
    rows = [
        BudgetRow(name, asked_K, 0.4 * asked_K, False, 0.42 * asked_K, cost, 1.0, {})
        for name, cost in (("gdi", 5.0), ("gdi-flow", 5.1))
        for asked_K in (4.0, 3.9, 2.0, 1.0, 0.98)
    ]
    yield "budget of scenes", budget_figure(rows)
    points = [
        Row("source", f"cells, {edge} mm", "isotropic", 1.0, 9.0, 9.0, 50.0 * edge, edge, 9.0)
        for edge in (0.05, 0.051, 0.4, 1.0, 1.01)
    ]
    yield "error of methods", error_figure(load_scene("gdi-cone"), points)
    for name in ("gdi-cone", "methane-jet"):
        yield f"optics: {name}", optics_figure(scene_optics(load_scene(name), cache=tables))


@pytest.mark.slow
def test_texts_are_apart(monkeypatch: pytest.MonkeyPatch, tables: Path) -> None:
    found = {name: faults(figure, monkeypatch) for name, figure in kinds(tables)}
    assert {name: each for name, each in found.items() if each} == {}


def test_the_check_finds_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    with style():
        figure = figure_of(2.0, 1.0, layout=None)
        figure.text(0.5, 0.5, "one")
        figure.text(0.55, 0.5, "other")
        figure.text(0.95, 0.1, "beyond the edge")
    said = " ".join(faults(figure, monkeypatch))
    assert "'one' on 'other'" in said and "'beyond the edge' is cut" in said
