"""The error of the whole picture against the time of the whole run, stated error beside it."""

from __future__ import annotations

import math
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

_CLOSE = 0.25  # of a logarithm, of points whose labels would cover each other
_TABS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple")
_COLOURS = dict(zip(BUDGET_SCENES, _TABS, strict=True))


@dataclass(frozen=True)
class BudgetRow:
    """One run of one scene.

    asked_K: `transport.accuracy_K`. stated_K: what the run states, but for what the reference
    shares; at_least: where something of it is unknown. true_K: RMS against the reference. causes_K:
    by name. seed: of the trace, and of a computed spray.
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
        """Stated over true error; None where nothing is stated."""
        return None if self.stated_K is None else self.stated_K / self.true_K


def true_error_K(run: Run, reference: Reference) -> float:
    """RMS of T_app against the reference, over the pixels that have one in both.

    Args:
        run: of as many pixels as the reference.
        reference: the true picture.

    Raises:
        BenchError: no pixel has a T_app in both.
    """
    here = run.maps.has_temperature & np.isfinite(reference.temperature_K)
    if not here.any():
        raise BenchError(f"{run.scene.name}: no pixel has a T_app in the reference as well")
    apart = run.maps.apparent_temperature_K.astype(float) - reference.temperature_K
    return float(np.sqrt(np.mean(apart[here] ** 2)))


def beside_reference(errors: Errors, scene: Scene) -> Errors:
    """The errors that a picture does not share with its reference.

    Args:
        errors: as the run states them.
        scene: of the run. The reference has as many rays a pixel; that of a computed spray is on
            the scene's own cells of gas.
    """
    shared = {"pixel sampling", *(["gas grid"] if scene.spray.model == "lagrangian" else [])}
    return Errors.of(cause for cause in errors.causes if cause.name not in shared)


def measure(
    scene: Scene,
    reference: Reference,
    device: Device,
    *,
    asked_K: float,
    cache: Path,
    seed: int = 1,
) -> BudgetRow:
    """Runs a scene once, from its spray to its errors, and compares it.

    Args:
        scene: with its keys left to the plan.
        reference: its true picture.
        device: traces.
        asked_K: error of the picture.
        cache: folder of tables; computed sprays are in it after the first run, and then not paid.
        seed: of the trace, and of a computed spray.
    """
    spray = {"spray": {"seed": seed}} if scene.spray.model == "lagrangian" else {}
    wanted = changed(scene, transport={"accuracy_K": asked_K, "seed": seed}, **spray)
    run, cost = clocked(device, lambda: simulate(wanted, device=device, cache=cache))
    assert run.errors is not None  # scenes of the benchmark are audited
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
    """Measures every scene that has a reference at every accuracy and seed.

    Args:
        device: traces.
        cache: folder of tables and computed sprays.
        say: told of each run.
        save: takes the part as far as it has come, after each accuracy.
        pixels: along an edge; there must be references of so many.
        scenes: of `BUDGET_SCENES`.
        asked_K: errors of the picture.
        seeds: 1 to this number.

    Raises:
        BenchError: no scene has a reference of so many pixels.
    """
    rows, left_out, errors_K = [], [], {}
    with tempfile.TemporaryDirectory() as folder:
        for name in scenes:
            reference = Reference.load(name, pixels=pixels)
            if reference is None:
                left_out.append(name)
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
                save(budget_part(rows, pixels=pixels, references_K=errors_K, left_out=left_out))
    if not rows:
        raise BenchError(
            f"no reference of {pixels} x {pixels} pixels for {', '.join(scenes)}; "
            "tests/bench/budget_reference.py makes them"
        )
    return budget_part(rows, pixels=pixels, references_K=errors_K, left_out=left_out)


def budget_part(
    rows: Sequence[BudgetRow],
    *,
    pixels: int,
    references_K: dict[str, float],
    left_out: Sequence[str],
) -> Part:
    """Tables and picture of the measured runs.

    Args:
        rows: of all scenes.
        pixels: along an edge.
        references_K: error of each scene's reference.
        left_out: scenes without one.
    """
    head = ("scene", "asked, K", "stated, K", "true, K", "stated / true", "core-s", "wall s")
    first = [row for row in rows if row.seed == rows[0].seed]
    names = list(dict.fromkeys(name for row in first for name in row.causes_K))
    by_cause = [
        (row.scene, f"{row.asked_K:g}", *(_cause(row.causes_K, name) for name in names))
        for row in first
    ]
    text = [
        f"{pixels} x {pixels} pixels. Time is that of the whole run, from the spray to the stated "
        "errors; sprays whose gas is computed, and tables, are in the cache. True is the RMS of "
        "T_app against the reference. Errors of the references themselves: "
        + ", ".join(f"{name} {error_K:.2g} K" for name, error_K in references_K.items())
        + ". They have as many rays a pixel as the runs: pixel sampling is in neither error."
    ]
    if "gdi-flow" in references_K:
        text.append(
            "The reference of gdi-flow has the run's own cells of gas: their error is in none."
        )
    if left_out:
        text.append(f"Without a reference of so many pixels: {', '.join(left_out)}.")
    return Part(
        name="budget",
        title="Error of the picture against time of the run",
        tables=(
            Table.of(head, [_line(row) for row in first]),
            Table.of(("scene", "asked, K", *(f"{name}, K" for name in names)), by_cause),
            *([] if len(first) == len(rows) else [_by_seeds(rows), _each_seed(rows)]),
        ),
        data={"pixels": pixels, "rows": [asdict(row) for row in rows]},
        text=tuple(text),
        figure=_figure(first),
        alternative="True and stated error of T_app against core seconds of the whole run",
    )


def _line(row: BudgetRow) -> tuple[str, ...]:
    stated = number(row.stated_K, 2)
    return (
        row.scene,
        f"{row.asked_K:g}",
        f"at least {stated}" if row.at_least and row.stated_K is not None else stated,
        number(row.true_K, 2),
        number(row.ratio, 2),
        number(row.core_s),
        number(row.wall_s),
    )


def _alike(rows: Sequence[BudgetRow]) -> Iterator[tuple[str, float, list[BudgetRow]]]:
    """Rows of all seeds of each scene and accuracy."""
    for name, kelvin in dict.fromkeys((row.scene, row.asked_K) for row in rows):
        yield name, kelvin, [row for row in rows if (row.scene, row.asked_K) == (name, kelvin)]


def _by_seeds(rows: Sequence[BudgetRow]) -> Table:
    """Lowest and highest over the seeds."""
    lines = []
    for name, kelvin, mine in _alike(rows):
        ratios = [row.ratio for row in mine if row.ratio is not None]
        lines.append(
            (
                name,
                f"{kelvin:g}",
                str(len(mine)),
                _range(ratios) if len(ratios) == len(mine) else "unknown",
                _range([row.true_K for row in mine]),
                _range([row.core_s for row in mine]),
            )
        )
    return Table.of(("scene", "asked, K", "seeds", "stated / true", "true, K", "core-s"), lines)


def _each_seed(rows: Sequence[BudgetRow]) -> Table:
    """Stated and true error and core seconds, in the order of the seeds."""
    lines = []
    for name, kelvin, mine in _alike(rows):
        columns: tuple[list[float | None], ...] = (
            [row.stated_K for row in mine],
            [row.true_K for row in mine],
            [row.core_s for row in mine],
        )
        texts = (", ".join(number(value, 2) for value in column) for column in columns)
        lines.append((name, f"{kelvin:g}", *texts))
    head = ("scene", "asked, K", "stated by seed, K", "true by seed, K", "core-s by seed")
    return Table.of(head, lines)


def _said(row: BudgetRow) -> str:
    stated = "unknown" if row.stated_K is None else f"{number(row.stated_K, 2)} K"
    return f"{stated} stated, {number(row.true_K, 2)} K true, {number(row.core_s)} core-s"


def _range(values: Sequence[float]) -> str:
    return f"{number(min(values), 2)} to {number(max(values), 2)}"


def _cause(causes_K: dict[str, float | None], name: str) -> str:
    if name not in causes_K:
        return "-"
    error_K = causes_K[name]
    return "unknown" if error_K is None else number(error_K, 2)


def _together(rows: Sequence[BudgetRow]) -> list[tuple[BudgetRow, str]]:
    """Rows whose points do not lie on each other, with what all there asked for."""
    out: list[tuple[BudgetRow, str]] = []
    for row in rows:
        if out:
            last, asked = out[-1]
            apart = max(
                abs(math.log(row.core_s / last.core_s)), abs(math.log(row.true_K / last.true_K))
            )
            if apart < _CLOSE:
                out[-1] = last, f"{asked}, {row.asked_K:g}"
                continue
        out.append((row, f"{row.asked_K:g}"))
    return out


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
        for row, asked in _together(mine):
            axes.annotate(
                f"{asked} K", (row.core_s, row.true_K), (4, 4), textcoords="offset points"
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("core seconds of the whole run")
    axes.set_ylabel("error of T_app, K RMS")
    axes.set_title("dots: true; crosses: stated; labels: asked", fontsize=9)
    axes.legend()
    axes.grid(True, which="both", alpha=0.3)
    return figure
