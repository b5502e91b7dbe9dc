"""Page of the scattering study: figure, findings, tables."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cldit.show.figures.colours import CHANGE
from cldit.show.figures.panels import Frame, Panel, panels_figure, window_around
from cldit.show.figures.style import png_of
from cldit.show.page import Figure
from cldit.study.page import Row as Cells
from cldit.study.page import StudyPage
from tests.bench.scattering.findings import findings
from tests.bench.scattering.run import LEAST_EMISSIVITY, Error, Row, Study

Floats = NDArray[np.float64]


def scattering_page(study: Study, *, command: str, seconds: float = 0.0) -> StudyPage:
    """Page of a study that `command` makes in `seconds`."""
    scene = study.scene
    mie = scene.transport.phase == "mie"
    how = "Droplets scatter by Mie's phase function" if mie else "Droplets scatter isotropically"
    description = scene.description.strip().rstrip(".")
    what = f"{description}. " if description else ""
    classes = {name: f"{name}, {_percent(part)}" for name, part in study.classes.items()}
    return StudyPage(
        name=f"{scene.name}{'-mie' if mie else ''}",
        title=f"Light of the walls: {scene.name}{', forward scattering' if mie else ''}",
        about=f"{what}{how}. Pixels with an emissivity of {LEAST_EMISSIVITY:g} or "
        f"more; walls at "
        f"{scene.walls.temperature_K:g} K.",
        command=command,
        findings=findings(study),
        figures={
            "errors": Figure(
                scattering_picture(study),
                "Errors of plain DIT, and with a model whose droplets are 20 % too large; each "
                "pair shares its colour scale.",
            )
        },
        table=[_main(row) for row in study.rows],
        more={
            "Where it fails: RMS / K by what the pixels see": [
                {
                    "evaluation": row.method,
                    "needs": row.needs,
                    **{title: _round(row.where[name], 1) for name, title in classes.items()},
                }
                for row in study.rows
            ]
        },
        scenes={scene.name: scene},
        seconds=seconds,
    )


def _main(row: Row) -> Cells:
    return {
        "evaluation": row.method,
        "needs": row.needs,
        **_error("what emits", row.medium),
        **_error("droplets", row.droplets),
        "noise / K": _round(row.noise_K),
        "bound's width / K": "open" if math.isinf(row.width_K) else _round(row.width_K, 1),
        "pixels with a result / %": _round(100 * row.answered, 0),
    }


def _error(what: str, error: Error | None) -> Cells:
    values = (math.nan,) * 3 if error is None else (error.bias_K, error.rms_K, 100 * error.held)
    titles = ("bias / K", "RMS / K", "bound holds / %")
    return {
        f"{what}: {title}": _round(value, digits)
        for title, value, digits in zip(titles, values, (2, 2, 0), strict=True)
    }


def _round(value: float, digits: int = 2) -> float:
    return round(value, digits) + 0.0 if math.isfinite(value) else math.nan  # no -0


def _percent(part: float) -> str:
    return f"{100 * part:.0f} % of the pixels"


def scattering_picture(study: Study) -> bytes:
    """PNG of the errors in K."""
    scene = study.scene
    x, _, z = scene.target_m
    panels = []
    images = list(study.errors.items())
    for number, (title, image) in enumerate(images):
        # Plain DIT and the better estimator share one scale.
        known = np.abs(images[number - number % 2][1])
        known = known[np.isfinite(known)]
        limit = max(float(np.percentile(known, 98)) if known.size else 1.0, 0.5)
        panels.append(Panel(image, title, "error / K", (-limit, limit), CHANGE))
    camera = scene.camera
    wide, high = (camera.field_m[axis] / camera.pixels[axis] for axis in (0, 1))
    frame = Frame((wide, high), (x, z))
    window = window_around(np.any([np.isfinite(image) for _, image in images], axis=0), frame)
    title = f"{scene.name}: errors of the temperature"
    return png_of(panels_figure(panels, frame, title=title, window=window))
