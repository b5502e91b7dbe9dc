"""Single droplets: evaporation models and published data, and errors of the integrator.

python -m tests.bench droplets --out docs/verification-droplets.md
python -m tests.bench droplets --convergence docs/droplet-convergence.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cldit.io.files import write_bytes, write_text
from cldit.run import default_cache
from cldit.spray.droplet.evaporation import MODELS
from cldit.spray.droplet.fluids import fuel_table, gas_table
from cldit.spray.droplet.follow import follow
from tests.bench.droplet_figure import convergence_picture
from tests.verify import droplet_published as published
from tests.verify.droplet_convergence import measure_all
from tests.verify.droplet_verification import (
    CONDITIONS,
    microgravity_K_mm2_s,
    nomura_K_mm2_s,
    suspended_mm2,
    wet_bulb,
)


def page(cache: Path) -> str:
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
            *_table(["gas, K", "measured", *names], _K_rows(cache)),
            "",
            "## Suspended droplets in air, d² in mm²",
            "",
            *_table(["case, time", "measured", *names], _suspended_rows(cache)),
            "",
            "## Wet bulb, K / steady K, mm²/s, of n-heptane in nitrogen",
            "",
            *_table(["gas", *names], _wet_bulb_rows(cache)),
            "",
            "## Lifetime in µs of a droplet of 9 µm, injected at 370 K",
            "",
            *_table(["gas", *names], _lifetime_rows(cache)),
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


def _K_rows(cache: Path) -> list[list[str]]:
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
                cache=cache,
            )
            for name in MODELS
        ]
        measured = published.verwey_birouk_mm2_s(gas_K)
        cells = [f"{value:.3f}" for value in (measured, *found)]
        rows.append([f"{gas_K:.0f}, 14 µm (Verwey)", *cells])
    return rows


def _suspended_rows(cache: Path) -> list[list[str]]:
    rows = []
    for case in published.SUSPENDED:
        found = [suspended_mm2(case, name, cache=cache) for name in MODELS]
        for number, (time, measured) in enumerate(
            zip(case.time_s, case.diameter2_mm2, strict=True)
        ):
            cells = [f"{column[number]:.2f}" for column in found]
            rows.append([f"{case.source}, {time:.0f} s", f"{measured:.2f}", *cells])
    return rows


def _wet_bulb_rows(cache: Path) -> list[list[str]]:
    fuel, gas = fuel_table("n-heptane", cache=cache), gas_table("nitrogen", cache=cache)
    rows = []
    for pressure, gas_K in CONDITIONS:
        found = [
            wet_bulb(fuel, gas, model, gas_K=gas_K, pressure_Pa=pressure * 1e6)
            for model in MODELS.values()
        ]
        cells = [f"{warm:.1f} / {k:.3f}" for warm, k in found]
        rows.append([f"{pressure:g} MPa, {gas_K} K", *cells])
    return rows


def _lifetime_rows(cache: Path) -> list[list[str]]:
    rows = []
    for pressure, gas_K in CONDITIONS:
        lives = [
            follow(
                fuel="n-heptane",
                diameter_m=9e-6,
                temperature_K=370.0,
                gas_temperature_K=gas_K,
                pressure_Pa=pressure * 1e6,
                model=name,
                points=2,
                cache=cache,
            )
            for name in MODELS
        ]
        cells = [f"{1e6 * life.time_s[-1]:.0f}" for life in lives]
        rows.append([f"{pressure:g} MPa, {gas_K} K", *cells])
    return rows


def main() -> None:
    """Writes the page, or the figure of the convergence."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="Markdown file")
    parser.add_argument("--convergence", type=Path, help="PNG of errors of the integrator")
    given = parser.parse_args()
    if given.convergence is not None:
        write_bytes(given.convergence, convergence_picture(*measure_all(default_cache())))
    if given.out is not None:
        write_text(given.out, page(default_cache()))
