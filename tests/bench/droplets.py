"""Single droplets: evaporation models and published data, and errors of the integrator.

python -m tests.bench droplets --out docs/verification-droplets.md
python -m tests.bench droplets --convergence docs/droplet-convergence.png
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import NullFormatter

from cldit.arrays import Floats
from cldit.gpu.device import Device, open_device
from cldit.io.files import write_bytes, write_text
from cldit.run import default_cache
from cldit.show.figures.style import WIDTH_IN, figure_of, png_of
from cldit.spray.droplet.models import MODELS
from tests.verify import droplet_published as published
from tests.verify.droplet_convergence import Case, Convergence, measure_all
from tests.verify.droplet_verification import (
    microgravity_K_mm2_s,
    nomura_K_mm2_s,
    suspended_mm2,
)

_COLOURS = ("#1b6ca8", "#e07b00", "#b3202c", "#7a4fa3", "#2f8f4e")
_SHAPES = ("o", "s", "^", "v", "D")


def convergence_picture(
    found: Sequence[Convergence],
    euler: Mapping[Case, tuple[Floats, Floats]],
) -> bytes:
    """PNG of error against step size (left) and run time (right), one row a case."""
    cases = list(dict.fromkeys(item.case for item in found))
    models = list(dict.fromkeys(item.model for item in found))
    figure = figure_of(WIDTH_IN, 2.2 * len(cases) + 0.8)
    grid = figure.subplots(len(cases), 2, squeeze=False)
    for case, (left, right) in zip(cases, grid, strict=True):
        for item in (item for item in found if item.case == case):
            style = {
                "color": _COLOURS[models.index(item.model) % len(_COLOURS)],
                "marker": _SHAPES[models.index(item.model) % len(_SHAPES)],
                "markersize": 8 - 1.3 * models.index(item.model),  # none hides another
                "label": item.model,
                "alpha": 0.8,
            }
            left.loglog(item.step_s * 1e6, item.step_error, **style)
            order = np.argsort(item.adaptive_seconds)
            right.loglog(item.adaptive_seconds[order] * 1e6, item.adaptive_error[order], **style)
        if case in euler:
            steps, error = euler[case]
            left.loglog(steps * 1e6, error, "k--", label="explicit Euler, abramzon-sirignano")
        left.set_title(case.name, fontsize=10, loc="left")
        right.set_title("steps chosen by the integrator", fontsize=10, loc="left")
        left.set_xlabel("step / µs")
        right.set_xlabel("processor time / µs per droplet")
        right.axhline(1e-3, color="grey", linewidth=0.8)
        for axes in (left, right):
            axes.set_ylim(1e-7, 2.0)
            axes.set_ylabel("error")
            axes.grid(alpha=0.3)
            axes.xaxis.set_minor_formatter(NullFormatter())
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    figure.suptitle(
        "Error of lifetime and of the mass at half of it, against Radau (rtol 1e-7)\n"
        "left: fixed steps, the last ends where the droplet vanishes",
        fontsize=11,
    )
    return png_of(figure)


def page(cache: Path, device: Device) -> str:
    """The tables, as Markdown."""
    names = list(MODELS)
    return "\n".join(
        [
            *_TOP,
            "## Evaporation constant K at rest, mm²/s",
            "",
            "Slope of d² between 80 % and 25 % of its first value. The experiments disagree by a",
            "factor of two: Nomura's droplets (0.7 mm) also received heat through their fibre and",
            "by radiation; Verwey and Birouk extrapolate droplets of 14 µm to a fibre of no",
            "thickness. Film theory (the first two columns) lies between them.",
            "",
            *_table(["gas, K", "measured", *names], _K_rows(cache, device)),
            "",
            "## Suspended droplets in air, d² in mm²",
            "",
            *_table(["case, time", "measured", *names], _suspended_rows(cache, device)),
            "",
        ]
    )


_TOP = (
    "# Verification of the droplet models",
    "",
    "Written by `python -m tests.bench droplets --out docs/verification-droplets.md`. No constant",
    "of a model is fitted to any of these figures.",
    "",
    "Sources: Nomura et al., Symp. (Int.) Combust. 26, 1267 (1996), as digitised for PeleLMeX;",
    "Verwey and Birouk (2023), by their fit K = 3.6552e-4 T - 0.1078; the validation cases",
    "kolaitis_heptane_1 and _2 of the Fire Dynamics Simulator.",
    "",
)


def _table(heading: list[str], rows: list[list[str]]) -> list[str]:
    lines = [heading, ["---"] * len(heading), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def _K_rows(cache: Path, device: Device) -> list[list[str]]:
    cases = [
        (f"{case.gas_temperature_K:.0f}, 0.7 mm (Nomura)", nomura_K_mm2_s(case), case, 0.7e-3)
        for case in published.NOMURA
    ]
    rows = []
    for label, measured, case, diameter in cases:
        found = [
            microgravity_K_mm2_s(
                name,
                gas_temperature_K=case.gas_temperature_K,
                pressure_Pa=published.NOMURA_Pa,
                diameter_m=diameter,
                device=device,
                cache=cache,
            )
            for name in MODELS
        ]
        rows.append([label, f"{measured:.3f}", *(f"{value:.3f}" for value in found)])
    for gas_K in published.VERWEY_BIROUK_K:
        found = [
            microgravity_K_mm2_s(
                name,
                gas_temperature_K=gas_K,
                pressure_Pa=101325.0,
                diameter_m=14e-6,
                device=device,
                cache=cache,
            )
            for name in MODELS
        ]
        measured = published.verwey_birouk_mm2_s(gas_K)
        cells = [f"{value:.3f}" for value in (measured, *found)]
        rows.append([f"{gas_K:.0f}, 14 µm (Verwey)", *cells])
    return rows


def _suspended_rows(cache: Path, device: Device) -> list[list[str]]:
    rows = []
    for case in published.SUSPENDED:
        found = [suspended_mm2(case, name, device=device, cache=cache) for name in MODELS]
        for number, (time, measured) in enumerate(
            zip(case.time_s, case.diameter2_mm2, strict=True)
        ):
            cells = [f"{column[number]:.2f}" for column in found]
            rows.append([f"{case.source}, {time:.0f} s", f"{measured:.2f}", *cells])
    return rows


def main() -> None:
    """Writes the page, or the figure of the convergence."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="Markdown file")
    parser.add_argument("--convergence", type=Path, help="PNG of errors of the integrator")
    given = parser.parse_args()
    if given.convergence is not None:
        write_bytes(
            given.convergence, convergence_picture(*measure_all(default_cache(), open_device()))
        )
    if given.out is not None:
        write_text(given.out, page(default_cache(), open_device()))
