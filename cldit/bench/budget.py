"""True and stated error of T_app against the time of whole runs."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cldit.accuracy.errors import Errors
from cldit.bench import ASKED_K, BUDGET_SCENES
from cldit.bench.budget_scenes import Reference, budget_scene
from cldit.bench.case import BenchError, Say, changed, clocked
from cldit.bench.report import Part, Table, number
from cldit.gpu.device import Device
from cldit.run import Run, simulate
from cldit.scene import Scene
from cldit.show.figures.sheet import figure_of

_HEAD = ("scene", "asked, K", "stated, K", "true, K", "stated / true", "core-s")
_TABS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple")
_COLOURS = dict(zip(BUDGET_SCENES, _TABS, strict=True))


@dataclass(frozen=True)
class BudgetRow:
    """One run of one scene.

    asked_K: `transport.accuracy_K`. stated_K: error that the run states, without the sources that
    it shares with the reference; at_least: one of them is unknown. true_K: RMS against the
    reference. causes_K: error by source. seed: of the trace, and of a computed spray.
    """

    scene: str
    asked_K: float
    stated_K: float | None
    at_least: bool
    true_K: float
    core_s: float
    wall_s: float
    causes_K: dict[str, float | None]
    seed: int = 1

    @property
    def ratio(self) -> float | None:
        """Stated over true error; None if nothing is stated."""
        return None if self.stated_K is None else self.stated_K / self.true_K


def true_error_K(run: Run, reference: Reference) -> float:
    """RMS of T_app against the reference of as many pixels, over the pixels that have one in both.

    Raises:
        BenchError: no pixel has a T_app in both.
    """
    here = run.maps.has_temperature & np.isfinite(reference.temperature_K)
    if not here.any():
        raise BenchError(f"{run.scene.name}: no pixel has a T_app in the reference as well")
    apart = run.maps.apparent_temperature_K.astype(float) - reference.temperature_K
    return float(np.sqrt(np.mean(apart[here] ** 2)))


def beside_reference(errors: Errors, scene: Scene) -> Errors:
    """Errors that a run does not share with its reference.

    The reference has as many rays per pixel, and that of a computed spray the same gas grid.
    """
    shared = {"pixel sampling", *(["gas grid"] if scene.spray.model == "lagrangian" else [])}
    return Errors.of(cause for cause in errors.causes if cause.name not in shared)


def measure(
    scene: Scene, reference: Reference, device: Device, *, asked_K: float, cache: Path, seed: int
) -> BudgetRow:
    """Runs a scene once, from the spray to the errors, and compares it with its reference.

    The run chooses the resolution for the tolerance `asked_K`; `cache` holds tables, and computed
    sprays after the first run.
    """
    spray = {"spray": {"seed": seed}} if scene.spray.model == "lagrangian" else {}
    wanted = changed(scene, transport={"accuracy_K": asked_K, "seed": seed}, **spray)
    run, cost = clocked(device, lambda: simulate(wanted, device=device, cache=cache))
    assert run.errors is not None  # these scenes are audited
    errors = beside_reference(run.errors, scene)
    return BudgetRow(
        scene=scene.name,
        asked_K=asked_K,
        stated_K=errors.total_K,
        at_least=bool(errors.unknown),
        true_K=true_error_K(run, reference),
        core_s=cost.core_s,
        wall_s=cost.wall_s,
        causes_K={cause.name: cause.error_K for cause in errors.causes},
        seed=seed,
    )


def budget(
    device: Device,
    *,
    cache: Path,
    say: Say,
    save: Callable[[Part], None],
    pixels: int = 100,
    scenes: Sequence[str] = BUDGET_SCENES,
    asked_K: Sequence[float] = ASKED_K,
    seeds: int = 1,
) -> Part:
    """Measures every scene that has a reference with every tolerance, `seeds` times.

    `pixels` along an edge are as many as the references have. `save` takes the unfinished part
    after each tolerance, `say` a line for each run.

    Raises:
        BenchError: no scene has a reference of so many pixels.
    """
    rows, missing, errors_K = [], [], {}
    with tempfile.TemporaryDirectory() as folder:
        for name in scenes:
            reference = Reference.load(name, pixels=pixels)
            if reference is None:
                missing.append(name)
                continue
            errors_K[name] = reference.error_K
            scene = budget_scene(name, pixels=pixels, folder=Path(folder))
            quick = changed(scene, transport={"accuracy_K": 20.0})
            simulate(quick, device=device, cache=cache)  # builds kernels, and the tables
            for kelvin in asked_K:
                for seed in range(1, seeds + 1):
                    row = measure(scene, reference, device, asked_K=kelvin, cache=cache, seed=seed)
                    say(f"{name}, {kelvin:g} K asked, seed {seed}: {_said(row)}")
                    rows.append(row)
                save(budget_part(rows, pixels=pixels, references_K=errors_K, missing=missing))
    if not rows:
        raise BenchError(
            f"no reference of {pixels} x {pixels} pixels for {', '.join(scenes)}; "
            "`python -m tests.bench budget_reference` makes them"
        )
    return budget_part(rows, pixels=pixels, references_K=errors_K, missing=missing)


def budget_part(
    rows: Sequence[BudgetRow],
    *,
    pixels: int,
    references_K: dict[str, float],
    missing: Sequence[str],
) -> Part:
    """Tables and figure of the measured runs, with the error of each reference; `missing` are
    scenes without one."""
    first = [row for row in rows if row.seed == rows[0].seed]
    names = list(dict.fromkeys(name for row in first for name in row.causes_K))
    by_source = [
        (
            row.scene,
            f"{row.asked_K:g}",
            *(_range([row.causes_K[name]]) if name in row.causes_K else "-" for name in names),
        )
        for row in first
    ]
    seeds = len({row.seed for row in rows})
    text = [
        f"{pixels} x {pixels} pixels"
        + (f", {seeds} seeds: lowest and highest" if seeds > 1 else "")
        + ". Time is that of the whole run, from the spray to the estimated errors; property "
        "tables and sprays with computed gas are in the cache. The true error is the RMS of T_app "
        "against the reference, whose own error is "
        + ", ".join(f"{error_K:.2g} K ({name})" for name, error_K in references_K.items())
        + ". References have as many rays per pixel as the runs, so pixel sampling is in neither "
        "error."
    ]
    if "gdi-flow" in references_K:
        text.append(
            "The reference of gdi-flow has the gas grid of the run: its error is in neither."
        )
    if missing:
        text.append(f"Without a reference of so many pixels: {', '.join(missing)}.")
    return Part(
        name="budget",
        title="Error of T_app against time of the run",
        tables=(
            Table.of(_HEAD, [_line(*alike) for alike in _alike(rows)]),
            Table.of(("scene", "asked, K", *(f"{name}, K" for name in names)), by_source),
        ),
        data={"pixels": pixels, "rows": [asdict(row) for row in rows]},
        text=tuple(text),
        figure=_figure(first),
        alternative="True and stated error of T_app against core seconds of the whole run",
    )


def _alike(rows: Sequence[BudgetRow]) -> Iterator[tuple[str, float, list[BudgetRow]]]:
    """Rows of all seeds of each scene and tolerance."""
    for name, kelvin in dict.fromkeys((row.scene, row.asked_K) for row in rows):
        yield name, kelvin, [row for row in rows if (row.scene, row.asked_K) == (name, kelvin)]


def _line(name: str, asked_K: float, rows: Sequence[BudgetRow]) -> tuple[str, ...]:
    stated = _range([row.stated_K for row in rows])
    if stated != "unknown" and any(row.at_least for row in rows):
        stated = f"at least {stated}"
    return (
        name,
        f"{asked_K:g}",
        stated,
        _range([row.true_K for row in rows]),
        _range([row.ratio for row in rows]),
        _range([row.core_s for row in rows]),
    )


def _said(row: BudgetRow) -> str:
    stated = "unknown" if row.stated_K is None else f"{number(row.stated_K, 2)} K"
    return f"{stated} stated, {number(row.true_K, 2)} K true, {number(row.core_s)} core-s"


def _range(values: Sequence[float | None]) -> str:
    """Lowest and highest value; `unknown` if one is unknown."""
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return "unknown"
    low, high = number(min(known), 2), number(max(known), 2)
    return low if low == high else f"{low} to {high}"


def _figure(rows: Sequence[BudgetRow]) -> Figure:
    figure = figure_of(7.0, 4.5)
    axes: Any = figure.subplots()
    for name in dict.fromkeys(row.scene for row in rows):
        mine = [row for row in rows if row.scene == name]
        colour = _COLOURS.get(name, "black")
        seconds = [row.core_s for row in mine]
        axes.plot(seconds, [row.true_K for row in mine], "o-", color=colour, label=name)
        stated = [np.nan if row.stated_K is None else row.stated_K for row in mine]
        axes.plot(seconds, stated, "x:", color=colour)
        for row in mine:
            place = row.core_s, row.true_K
            axes.annotate(f"{row.asked_K:g} K", place, (4, 4), textcoords="offset points")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("core seconds of the whole run")
    axes.set_ylabel("error of T_app, K RMS")
    axes.set_title("dots: true; crosses: stated; labels: asked", fontsize=9)
    axes.legend()
    axes.grid(True, which="both", alpha=0.3)
    return figure
