"""Single droplets: evaporation models and published data.

python -m tests.bench droplets --out docs/verification-droplets.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cldit.gpu.device import Device, open_device
from cldit.run import default_cache
from cldit.show.page import Page, Section, Table, write_page
from cldit.spray.droplet.models import MODELS
from tests.verify import droplet_published as published
from tests.verify.droplet_verification import (
    microgravity_K_mm2_s,
    nomura_K_mm2_s,
    suspended_mm2,
)


def page(cache: Path, device: Device) -> Page:
    """The tables."""
    names = list(MODELS)
    return Page(
        "Verification of the droplet models",
        [
            "Written by `python -m tests.bench droplets --out docs/verification-droplets.md`. No "
            "constant of a model is fitted to any of these figures.",
            "Sources: Nomura et al., Symp. (Int.) Combust. 26, 1267 (1996), as digitised for "
            "PeleLMeX; Verwey and Birouk (2023), by their fit K = 3.6552e-4 T - 0.1078; the "
            "validation cases kolaitis_heptane_1 and _2 of the Fire Dynamics Simulator.",
            Section(
                "Evaporation constant K at rest, mm²/s",
                [
                    "Slope of d² between 80 % and 25 % of its first value. The experiments "
                    "disagree by a factor of two: Nomura's droplets (0.7 mm) also received heat "
                    "through their fibre and by radiation; Verwey and Birouk extrapolate droplets "
                    "of 14 µm to a fibre of no thickness. Film theory (the first two columns) lies "
                    "between them.",
                    Table(["gas, K", "measured", *names], _K_rows(cache, device)),
                ],
            ),
            Section(
                "Suspended droplets in air, d² in mm²",
                [Table(["case, time", "measured", *names], _suspended_rows(cache, device))],
            ),
        ],
    )


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
    """Writes the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="Markdown file", required=True)
    write_page(page(default_cache(), open_device()), parser.parse_args().out)
