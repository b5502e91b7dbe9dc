"""Error against run time of the transport on one scene and one machine: `cldit bench transport`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.dit.accuracy import VISIBLE_EMISSIVITY
from cldit.gpu.device import Device
from cldit.report.sheet import figure_of, png_of
from cldit.run import Run, simulate
from cldit.scene import Scene, parse_scene

Way = tuple[str, dict[str, Any]]  # label, and what it changes in the scene's `transport`

WAYS: tuple[Way, ...] = (
    *((f"source, {n} directions", {"directions": n}) for n in (8, 16, 32, 64, 96)),
    *((f"source, order {n}", {"order": n}) for n in (0, 1, 2, 3)),
)
QUICK: tuple[Way, ...] = (WAYS[0], WAYS[1], WAYS[5], WAYS[6])
REFERENCE: dict[str, Any] = {"directions": 256, "seed": 2}


@dataclass(frozen=True)
class Row:
    """One way of tracing: seconds of scattering and picture, and errors against the reference.

    stated_K: the error that the run itself estimates; None for a truncated order.
    """

    label: str
    seconds: float
    rms_K: float
    largest_K: float
    rms_background: float
    rms_wall: float
    stated_K: float | None


def _with(scene: Scene, changes: dict[str, Any]) -> Scene:
    data = scene.model_dump(mode="json")
    data["transport"].update(changes)
    return parse_scene(data, source="bench")


def bench_transport(
    scene: Scene,
    device: Device,
    ways: Sequence[Way] = WAYS,
    *,
    say: Callable[[str], None] | None = None,
) -> list[Row]:
    """Traces the scene in every way and compares with many directions, another seed.

    Times are of this machine as it is now: compare rows, not machines.
    """
    if say is not None:
        say("reference: " + ", ".join(f"{key} {value}" for key, value in REFERENCE.items()))
    truth = simulate(_with(scene, REFERENCE), device=device)
    rows = []
    for label, changes in ways:
        row = _row(label, simulate(_with(scene, changes), device=device), truth)
        if say is not None:
            say(f"{label}: {row.seconds:.2f} s, {row.rms_K:.3f} K RMS")
        rows.append(row)
    return rows


def _row(label: str, run: Run, truth: Run) -> Row:
    visible = (truth.maps.emissivity > VISIBLE_EMISSIVITY) & np.isfinite(
        truth.maps.apparent_temperature_K
    )
    kelvin = (run.maps.apparent_temperature_K - truth.maps.apparent_temperature_K)[visible]
    kelvin = kelvin[np.isfinite(kelvin)].astype(float)
    cost = {stage.name: stage.seconds for stage in run.info.stages}
    converged = run.scene.transport.order is None
    return Row(
        label=label,
        seconds=cost["scattering"] + cost["image"],
        rms_K=float(np.sqrt(np.mean(kelvin**2))) if kelvin.size else 0.0,
        largest_K=float(np.max(np.abs(kelvin), initial=0.0)),
        rms_background=_rms(run.weights.background, truth.weights.background, visible),
        rms_wall=_rms(run.weights.wall, truth.weights.wall, visible),
        stated_K=run.info.accuracy_K if converged else None,
    )


def _rms(one: Any, other: Any, where: Any) -> float:
    difference = (one.astype(float) - other)[where]
    return float(np.sqrt(np.mean(difference**2))) if difference.size else 0.0


def write_bench(rows: Sequence[Row], folder: Path, *, title: str) -> Path:
    """Writes bench.json and bench.png (error against seconds); returns the picture's path."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps([asdict(row) for row in rows], indent=2)
    (folder / "bench.json").write_text(text, encoding="utf-8")
    figure = figure_of(6.6, 4.4)
    axes = figure.subplots()
    for row in rows:
        marker = "s" if "order" in row.label else "o"
        axes.loglog(row.seconds, max(row.rms_K, 1e-4), marker, color="tab:blue")
        axes.annotate(
            row.label.removeprefix("source, "),
            (row.seconds, max(row.rms_K, 1e-4)),
            textcoords="offset points",
            xytext=(5, 4),
            fontsize=7.5,
        )
    axes.set_xlabel("scattering and picture / s")
    axes.set_ylabel("RMS error of apparent temperature / K")
    axes.set_title(title, fontsize=10)
    axes.grid(True, which="both", alpha=0.3)
    path = folder / "bench.png"
    path.write_bytes(png_of(figure))
    return path
