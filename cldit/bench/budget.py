"""True and stated error of T_app against the time of whole runs."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cldit.accuracy.errors import Errors
from cldit.accuracy.sources.gas_grid import GAS_GRID
from cldit.bench import ASKED_K, BUDGET_SCENES
from cldit.bench.budget_scenes import Reference, budget_scene
from cldit.bench.case import BenchError, Say, changed, clocked
from cldit.bench.report import Part, number
from cldit.gpu.device import Device
from cldit.io.origin import commit
from cldit.io.plain_data import read_json
from cldit.run import Run, simulate
from cldit.scene import Scene
from cldit.show.figures.style import figure_of, finish, plain_ticks, styled
from cldit.show.page import Table

_HEAD = ("scene", "asked, K", "stated, K", "true, K", "stated / true", "held by", "core-s")
_TABS = ("blue", "orange", "green", "red", "purple", "brown", "olive")
_COLOURS = {name: f"tab:{tab}" for name, tab in zip(BUDGET_SCENES, _TABS, strict=True)}


@dataclass(frozen=True)
class BudgetRow:
    """One run of one scene.

    asked_K: `transport.accuracy_K`. stated_K: error that the run states, without the sources that
    it shares with the reference; at_least: one of them is unknown. true_K: RMS against the
    reference. causes_K: error by source. held: what holds its error above the tolerance, as the run
    remarks; empty where it is kept. seed: of the trace, and of a spray of parcels. commit: of the
    sources.
    """

    scene: str
    asked_K: float
    stated_K: float | None
    at_least: bool
    true_K: float
    core_s: float
    wall_s: float
    causes_K: dict[str, float | None]
    held: str = ""
    seed: int = 1
    commit: str = ""

    @property
    def ratio(self) -> float | None:
        """Stated over true error; None if nothing is stated."""
        return None if self.stated_K is None else self.stated_K / self.true_K


def true_error_K(run: Run, reference: Reference) -> float:
    """RMS of T_app against the reference of as many pixels, where both have one."""
    valid = run.maps.has_temperature & np.isfinite(reference.temperature_K)
    if not valid.any():
        raise BenchError(f"{run.scene.name}: no pixel has a T_app in the reference as well")
    difference_K = run.maps.apparent_temperature_K.astype(float) - reference.temperature_K
    return float(np.sqrt(np.mean(difference_K[valid] ** 2)))


def beside_reference(errors: Errors, scene: Scene) -> Errors:
    """Errors that a run does not share with its reference, which has the same grid of gas."""
    has_gas_grid = scene.spray.model in ("lagrangian", "cfd")
    shared = {GAS_GRID.name, *GAS_GRID.also} if has_gas_grid else set()
    return Errors.of(cause for cause in errors.causes if cause.name not in shared)


def held_by(run: Run, asked_K: float) -> str:
    """Source and key that hold the error above the tolerance, as the run remarks; else empty."""
    errors = run.errors
    largest = None if errors is None else errors.largest()
    if errors is None or largest is None or not errors.exceed(asked_K):
        return ""
    if not any(
        remark.startswith("stated error") and largest.name in remark for remark in run.info.remarks
    ):
        raise BenchError(f"{run.scene.name}: {errors.text} for {asked_K:g} K without a remark")
    return f"{largest.name} ({largest.fixed})" if largest.fixed else largest.name


def measure(
    scene: Scene, reference: Reference, device: Device, *, asked_K: float, cache: Path
) -> BudgetRow:
    """Runs a scene once, from the spray to the errors, and compares it with its reference.

    The run chooses the resolution for the tolerance `asked_K`; `cache` holds tables, and computed
    sprays after the first run.
    """
    requested = changed(scene, transport={"accuracy_K": asked_K})
    run, cost = clocked(device, lambda: simulate(requested, device=device, cache=cache))
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
        held=held_by(run, asked_K),
        seed=scene.transport.seed,
        commit=(commit() or "")[:7],
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
    earlier_rows: Sequence[BudgetRow] = (),
) -> Part:
    """Measures every scene that has a reference with every tolerance, `seeds` times.

    `pixels` along an edge are as many as the references have. `earlier_rows` are those of other
    scenes, measured earlier. `save` takes the unfinished part after each tolerance, `say` a line
    for each run.
    """
    rows = [row for row in earlier_rows if row.scene not in scenes]
    missing: list[str] = []
    errors_K = {
        name: stored.error_K
        for name in dict.fromkeys(row.scene for row in rows)
        if (stored := Reference.load(name, pixels=pixels)) is not None
    }
    with tempfile.TemporaryDirectory() as folder:
        for name in scenes:
            reference = Reference.load(name, pixels=pixels)
            if reference is None:
                missing.append(name)
                continue
            errors_K[name] = reference.error_K
            seeded_scenes = [
                budget_scene(name, pixels=pixels, folder=Path(folder), seed=seed)
                for seed in range(1, seeds + 1)
            ]
            quick = changed(seeded_scenes[0], transport={"accuracy_K": 20.0})
            simulate(quick, device=device, cache=cache)  # builds kernels, and the tables
            for kelvin in asked_K:
                for scene in seeded_scenes:
                    row = measure(scene, reference, device, asked_K=kelvin, cache=cache)
                    say(f"{name}, {kelvin:g} K asked, seed {row.seed}: {_summary(row)}")
                    rows.append(row)
                save(budget_part(rows, pixels=pixels, references_K=errors_K, missing=missing))
    if not rows:
        raise BenchError(
            f"no reference of {pixels} x {pixels} pixels for {', '.join(scenes)}; "
            "`python -m tests.bench budget_reference` makes them"
        )
    return budget_part(rows, pixels=pixels, references_K=errors_K, missing=missing)


def stored_rows(folder: Path, *, pixels: int) -> list[BudgetRow]:
    """Rows that an earlier part of the measurement wrote for so many pixels."""
    path = folder / "budget.json"
    data = read_json(path, error=BenchError) if path.is_file() else {}
    return [BudgetRow(**row) for row in data.get("rows", ()) if data.get("pixels") == pixels]


def budget_part(
    rows: Sequence[BudgetRow],
    *,
    pixels: int,
    references_K: dict[str, float],
    missing: Sequence[str],
) -> Part:
    """Tables and figure of the measured runs, with the error of each reference; `missing` are
    scenes without one."""
    one_seed = [row for row in rows if row.seed == rows[0].seed]
    counts = sorted({len(alike) for *_, alike in _alike(rows)})
    seeds = " to ".join(dict.fromkeys(str(count) for count in (counts[0], counts[-1])))
    paragraphs = [
        f"{pixels} x {pixels} pixels"
        + (f", {seeds} seeds: lowest and highest" if counts[-1] > 1 else "")
        + ". Time is that of the whole run, from the spray to the estimated errors; property "
        "tables and sprays with computed gas are in the cache. The true error is the RMS of T_app "
        "against the reference, whose own error is "
        + ", ".join(f"{error_K:.2g} K ({name})" for name, error_K in references_K.items())
        + f". All runs take {number(sum(row.core_s for row in rows) / 60)} core-min."
    ]
    if {"gdi", "imported"} & set(references_K):
        paragraphs.append(
            "References of gdi and of the imported case have the gas grid of the run: its "
            "error is in neither."
        )
    commits = sorted({row.commit for row in rows} - {""})
    if len(commits) > 1:
        paragraphs.append(f"Measured in parts, at commits {', '.join(commits)}.")
    if missing:
        paragraphs.append(f"Without a reference of so many pixels: {', '.join(missing)}.")
    return Part(
        name="budget",
        title="Error of T_app against time of the run",
        tables=(Table(_HEAD, [_line(*alike) for alike in _alike(rows)]),),
        data={"pixels": pixels, "rows": [asdict(row) for row in rows]},
        text=tuple(paragraphs),
        figure=budget_figure(one_seed),
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
        ", ".join(sorted({row.held for row in rows} - {""})) or "-",
        _range([row.core_s for row in rows]),
    )


def _summary(row: BudgetRow) -> str:
    stated = "unknown" if row.stated_K is None else f"{number(row.stated_K, 2)} K"
    return f"{stated} stated, {number(row.true_K, 2)} K true, {number(row.core_s)} core-s"


def _range(values: Sequence[float | None]) -> str:
    """Lowest and highest value; `unknown` if one is unknown."""
    numbers = [value for value in values if value is not None]
    if len(numbers) < len(values):
        return "unknown"
    low, high = number(min(numbers), 2), number(max(numbers), 2)
    return low if low == high else f"{low} to {high}"


@styled
def budget_figure(rows: Sequence[BudgetRow]) -> Figure:
    """Figure of true and stated errors against the cost of a run, by scene."""
    figure = figure_of(5.0, 3.6)
    axes: Any = figure.subplots()
    axes.set(xscale="log", yscale="log")
    tolerances_K = sorted({row.asked_K for row in rows}, reverse=True)
    marker = {kelvin: "osD^v"[at % 5] for at, kelvin in enumerate(tolerances_K)}
    for row in rows:
        colour = _COLOURS.get(row.scene, "black")
        if row.stated_K is not None:
            axes.plot([row.core_s] * 2, [row.true_K, row.stated_K], ":", color=colour, lw=0.8)
            axes.plot(row.core_s, row.stated_K, "x", color=colour)
        axes.plot(row.core_s, row.true_K, marker[row.asked_K], color=colour, ms=4.5)
    for name in dict.fromkeys(row.scene for row in rows):
        axes.plot([], [], lw=3, color=_COLOURS.get(name, "black"), label=name)
    for kelvin in tolerances_K:
        axes.plot([], [], marker[kelvin], color="0.4", ms=4.5, label=f"true, {kelvin:g} K asked")
    axes.plot([], [], "x", color="0.4", label="stated")
    plain_ticks(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    finish(axes, "core seconds of the whole run", "RMS error of apparent temperature / K",
           minor=True)  # fmt: skip
    return figure
