"""Table and picture of what an evaluation that knows about scattering gains."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cldit.report.pictures import Frame, Panel, panels_picture
from cldit.study.page import markdown_table
from cldit.study.scattering.run import Error, Row, Study

Floats = NDArray[np.float64]

_HEAD = (
    "evaluation",
    "needs",
    "what emits: bias / K",
    "RMS / K",
    "bound holds",
    "droplets: bias / K",
    "RMS / K",
    "bound holds",
    "noise / K",
    "bound's width / K",
    "told",
)


def _cell(value: float, digits: int = 2) -> str:
    if math.isinf(value):
        return "open"
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def _percent(value: float) -> str:
    return "–" if math.isnan(value) else f"{100 * value:.0f} %"


def _error(error: Error | None) -> list[str]:
    if error is None:
        return ["–"] * 3
    return [_cell(error.bias_K), _cell(error.rms_K), _percent(error.held)]


def _rest(row: Row) -> list[str]:
    return [_cell(row.noise_K), _cell(row.width_K, 1), _percent(row.told)]


def scattering_table(study: Study) -> str:
    """The rows as a Markdown table, and a second one of where each fails."""
    rows = [
        [row.method, row.needs, *_error(row.medium), *_error(row.droplets), *_rest(row)]
        for row in study.rows
    ]
    heads = [f"{name} ({_percent(part)})" for name, part in study.classes.items()]
    where = [
        [row.method, row.needs, *(_cell(value, 1) for value in row.where.values())]
        for row in study.rows
    ]
    return (
        f"{markdown_table(_HEAD, rows)}\n\nRMS in K by the scattered share of the pixels, and in "
        f"thin ones (emissivity below 0.5):\n\n{markdown_table([*_HEAD[:2], *heads], where)}\n"
    )


def scattering_picture(study: Study) -> bytes:
    """PNG of the errors in K."""
    scene = study.scene
    x, _, z = scene.target_m
    images = list(study.errors.items())
    rows, columns = _around([image for _, image in images])
    panels = []
    for number, (title, image) in enumerate(images):
        # Two and two share their colours: plain DIT, and what is gained over it.
        known = np.abs(images[number - number % 2][1])
        known = known[np.isfinite(known)]
        limit = max(float(np.percentile(known, 98)) if known.size else 1.0, 0.5)
        panels.append(Panel(image[rows, columns], title, "error / K", (-limit, limit), "RdBu_r"))
    camera = scene.camera
    wide, high = (camera.field_m[axis] / camera.pixels[axis] for axis in (0, 1))
    height, width = images[0][1].shape
    centre_m = (
        x + ((columns.start + columns.stop) / 2.0 - width / 2.0) * wide,
        z - ((rows.start + rows.stop) / 2.0 - height / 2.0) * high,
    )
    return panels_picture(
        panels,
        Frame(pixel_m=(wide, high), centre_m=centre_m),
        title=f"{scene.name}: errors of the temperature",
    )


def _around(images: Sequence[Floats]) -> tuple[slice, slice]:
    """The part of the pictures in which anything is known, with a margin."""
    known = np.any([np.isfinite(image) for image in images], axis=0)
    if not known.any():
        return slice(0, known.shape[0]), slice(0, known.shape[1])
    spans = []
    for axis in (1, 0):
        places = np.flatnonzero(known.any(axis=axis))
        spans.append(slice(max(int(places[0]) - 4, 0), int(places[-1]) + 5))
    rows, columns = spans
    return slice(rows.start, min(rows.stop, known.shape[0])), slice(
        columns.start, min(columns.stop, known.shape[1])
    )
