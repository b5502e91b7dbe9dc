"""What several rays a pixel cost, and what they bring: `cldit bench rays`.

All ways see one and the same solution (same seed), so that the difference is that of the pixels.
They look at the middle of the field, a sixteenth of it, with pixels as large as the scene's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.bench.case import changed
from cldit.bench.report import Table
from cldit.dit.accuracy import VISIBLE_EMISSIVITY
from cldit.gpu.device import Device
from cldit.run import Run, simulate
from cldit.scene import Scene

MOST = 64
PART = 4  # of the field, each way
WAYS: tuple[int | str, ...] = (1, "adaptive", 4, 16)


@dataclass(frozen=True)
class Row:
    """rays: a pixel. traced: rays a pixel in all, the picture's cost. rms_K, largest_K: of T_app
    against 64 rays, over pixels of emissivity above 0.05; rms_background: of the weight, over all
    pixels. several: share of the pixels with more than one ray."""

    rays: int | str
    traced: float
    rms_K: float
    largest_K: float
    rms_background: float
    several: float


def bench_rays(
    scene: Scene, device: Device, *, say: Callable[[str], None] | None = None
) -> list[Row]:
    """One run for each of `WAYS`, and one with 64 rays to compare with."""
    (columns, rows), (width_m, height_m) = scene.camera.pixels, scene.camera.field_m
    few = (max(columns // PART, 1), max(rows // PART, 1))
    middle = {"pixels": few, "field_m": (width_m * few[0] / columns, height_m * few[1] / rows)}

    def run(rays: int | str) -> Run:
        if say is not None:
            say(f"rays a pixel: {rays}")
        return simulate(changed(scene, camera={**middle, "rays_per_pixel": rays}), device=device)

    truth = run(MOST)
    return [_row(rays, run(rays), truth) for rays in WAYS]


def _row(rays: int | str, run: Run, truth: Run) -> Row:
    there = truth.maps.apparent_temperature_K.astype(float)
    kelvin = (run.maps.apparent_temperature_K - there)[truth.maps.emissivity > VISIBLE_EMISSIVITY]
    kelvin = kelvin[np.isfinite(kelvin)]
    background = run.weights.background.astype(float) - truth.weights.background
    columns, rows = run.scene.camera.pixels
    several = run.info.counts.get("pixels_of_several_rays", 0) / (columns * rows)
    return Row(
        rays=rays,
        traced=1 + 16 * several if isinstance(rays, str) else float(rays),
        rms_K=float(np.sqrt(np.mean(kelvin**2))) if kelvin.size else 0.0,
        largest_K=float(np.max(np.abs(kelvin), initial=0.0)),
        rms_background=float(np.sqrt(np.mean(background**2))),
        several=several,
    )


def table(rows: list[Row]) -> Table:
    """For people."""
    head = ("rays a pixel", "traced a pixel", "T_app RMS / K", "largest / K", "w_bg RMS",
            "pixels of several rays")  # fmt: skip
    body: list[list[Any]] = [
        [
            str(row.rays),
            f"{row.traced:.1f}",
            f"{row.rms_K:.3f}",
            f"{row.largest_K:.1f}",
            f"{row.rms_background:.1e}",
            f"{100 * row.several:.1f} %",
        ]
        for row in rows
    ]
    return Table.of(head, body)
