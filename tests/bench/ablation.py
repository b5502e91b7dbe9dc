"""Error and time of `source` with each of its mechanisms switched off in turn."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.bench.case import Say, changed
from cldit.bench.report import Part, number
from cldit.gpu.device import Device
from cldit.scene import Scene, load_scene, parse_scene
from cldit.show.page import Table
from cldit.transport.trace import TraceSettings
from tests.bench.case import Case, Lattice
from tests.bench.error import Truth
from tests.bench.page import write_measured
from tests.verify.blocks import Blocks
from tests.verify.slab import run_slab

SEEDS = 4
_INF = float("inf")


def _tuned(**numbers: Any) -> Callable[[TraceSettings], TraceSettings]:
    return lambda settings: replace(settings, tuning=replace(settings.tuning, **numbers))


# What is switched off, and how: settings with every mechanism -> settings without this one.
MECHANISMS: dict[str, Callable[[TraceSettings], TraceSettings]] = {
    "defect correction (all ordinates in GMRES)": _tuned(solver_share=1.0),
    "denser moment sweeps": _tuned(moment_share=1),
    "linear sources": _tuned(linear_depth=_INF),
    "sources linear by diffusion": _tuned(diffusion_most=0.0),
    "delta-M": _tuned(delta_m=False),
    "boundary blurred by the forward peak": _tuned(blurred_boundary=False),
    "ordinates denser towards the camera": _tuned(lean=0.0),
    "gradients by the final sweeps": _tuned(spatial_from=2**30, spatial_from_phase=2**30),
    "limit of these in depth": _tuned(gradient_depth=_INF),
    "margin around thick cells": _tuned(margin=0),
    "paths beyond one segment": _tuned(segments=1),
    "paths at high albedo": _tuned(path_albedo=_INF, path_twice=_INF),
    "early ends of paths": _tuned(end_weight=0.01),
    "final gather": lambda settings: replace(settings, gather=False),
    "extinction linear in cells": lambda settings: replace(settings, linear_coefficients=False),
}


@dataclass(frozen=True)
class Ablation:
    """One mechanism on one scene, over seeds.

    error_K: RMS over seeds of the RMS error of T_app; worth: error^2 x time without the mechanism
    over that with all, seed by seed (geometric mean); scatter: standard error of its logarithm.
    """

    scene: str
    without: str
    error_K: float
    core_s: float
    worth: float
    scatter: float

    @property
    def verdict(self) -> str:
        """Beyond two standard errors; the logarithm of `worth` is what scatters evenly."""
        clear = abs(np.log(self.worth)) > 2 * self.scatter
        return "no effect" if not clear else "gains" if self.worth > 1 else "costs"


def slab_scene(blocks: Blocks) -> Scene:
    """Droplets of depth 20 and albedo 0.9 in 16 layers in front of a hot disc."""
    return parse_scene(
        run_slab(
            blocks.scene,
            20.0,
            0.9,
            layers=16,
            cells=64,
            camera={"pixels": [96, 96], "field_m": [0.16, 0.16]},
            background={"radius_m": 0.08, "temperatures_K": [400.0, 500.0]},
            name="slab",
        )
    )


def ablate(case: Case, *, phase: str, accuracy_K: float, seeds: int, say: Say) -> list[Ablation]:
    """Rows for one scene: with all mechanisms, then without each of them."""
    pixels = case.scene.camera.pixels
    every = max(1, round(min(pixels) / 100)) | 1
    lattice = Lattice((every, every))
    truth = Truth.of(case.seen(lattice.of(case.scene)), samples=4096, phase=phase)
    part = case.seen(lattice.of(case.scene))
    say(f"{case.scene.name}: truth is good to {truth.noise_K:.3f} K")
    whole = case.settings(phase=phase, accuracy_K=accuracy_K, audit=False, method="source")
    rows: list[Ablation] = []
    base = np.zeros(0)
    for name, without in {"(all)": lambda settings: settings, **MECHANISMS}.items():
        settings = without(whole)
        case.run(replace(settings, accuracy_K=10.0))  # builds
        costs, squares = [], []
        for seed in range(seeds):
            result, cost = case.run(replace(settings, seed=settings.seed + seed))
            kelvin = part.temperature_K(lattice.pick(case.scene, result.weights))
            costs.append(cost.core_s)
            squares.append(truth.rms(kelvin) ** 2)
        merit = np.log(np.maximum(squares, truth.noise_K**2 / 100) * np.array(costs))
        base = merit if not rows else base
        ratio = merit - base
        rows.append(
            Ablation(
                scene=case.scene.name,
                without=name,
                error_K=float(np.sqrt(np.mean(squares))),
                core_s=float(np.mean(costs)),
                worth=float(np.exp(ratio.mean())),
                scatter=float(ratio.std(ddof=1) / seeds**0.5),
            )
        )
        say(
            f"{case.scene.name}: without {name}: {rows[-1].error_K:.4f} K at "
            f"{rows[-1].core_s:.2f} core-s, {rows[-1].worth:.2f} times error^2 x time"
        )
    return rows


def ablation(device: Device, *, cache: Path, say: Say, seeds: int = SEEDS) -> Part:
    """Measures gdi, droplets with Mie's phase function, and a thick slab."""
    small = {"camera": {"pixels": [300, 300]}}
    gdi = changed(load_scene("gdi-cone"), **small)
    droplets = changed(load_scene("droplets-only"), **small)
    rows: list[Ablation] = []
    with tempfile.TemporaryDirectory() as folder:
        cases: Sequence[tuple[Scene, str]] = (
            (gdi, "isotropic"),
            (droplets, "mie"),
            (slab_scene(Blocks(device, Path(folder), cache)), "isotropic"),
        )
        for scene, phase in cases:
            told = changed(scene, transport={"phase": phase, "method": "source", "order": None})
            case = Case.of(told, device, cache=cache)
            rows += ablate(case, phase=phase, accuracy_K=0.05, seeds=seeds, say=say)
    head = ("scene", "without", "RMS error, K", "core-s", "error^2 x time", "+-", "verdict")
    table = Table(
        head,
        [
            (
                row.scene,
                row.without,
                number(row.error_K),
                number(row.core_s),
                number(row.worth),
                f"{100 * row.scatter:.0f} %",
                row.verdict,
            )
            for row in rows
        ],
    )
    return Part(
        name="ablation",
        title="Every mechanism switched off in turn",
        tables=(table,),
        data=[asdict(row) for row in rows],
        text=(
            f"At 0.05 K asked, {seeds} seeds each. `error^2 x time`: without the mechanism over "
            "that with all of them; above 1 the mechanism gains, and it is the factor in time at "
            "the same error. Verdicts are beyond two standard errors.",
        ),
    )


def main() -> None:
    """Writes ablation.md."""
    write_measured(lambda given: ablation(given.device, cache=given.cache, say=given.say))
