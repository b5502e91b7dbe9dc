"""Table and picture of what an evaluation that knows about scattering gains."""

from __future__ import annotations

import math

import numpy as np

from cldit.report.pictures import Frame, Panel, panels_picture
from cldit.scattering_study import Study

_HEAD = (
    "| evaluation | model | what emits: bias / K | RMS / K | droplets: bias / K | RMS / K "
    "| noise / K | told |\n|---|---|---|---|---|---|---|---|\n"
)


def _cell(value: float, digits: int = 2) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def scattering_table(study: Study) -> str:
    """The rows as a Markdown table."""
    lines = [
        f"| {row.method} | {row.model} | {_cell(row.medium_bias_K)} | {_cell(row.medium_rms_K)} "
        f"| {_cell(row.droplets_bias_K)} | {_cell(row.droplets_rms_K)} | {_cell(row.noise_K)} "
        f"| {100 * row.told:.0f} % |"
        for row in study.rows
    ]
    return _HEAD + "\n".join(lines) + "\n"


def scattering_picture(study: Study) -> bytes:
    """PNG of the errors in K."""
    scene = study.scene
    x, _, z = scene.target_m
    panels = []
    for title, image in study.errors.items():
        known = np.abs(image[np.isfinite(image)])
        limit = max(float(np.percentile(known, 98)) if known.size else 1.0, 0.5)
        panels.append(Panel(image, title, "error / K", (-limit, limit), "RdBu_r"))
    camera = scene.camera
    pixel_m = (camera.field_m[0] / camera.pixels[0], camera.field_m[1] / camera.pixels[1])
    return panels_picture(
        panels,
        Frame(pixel_m=pixel_m, centre_m=(x, z)),
        title=f"{scene.name}: errors of the temperature",
    )
