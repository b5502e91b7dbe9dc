"""Figs. 7 and 8: maps over pressure and temperature of the gas, with and without filter."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cldit.io.files import make_folder, write_text
from cldit.optics.vapour import vapour_band
from cldit.run import Run
from cldit.scene import Scene
from cldit.show.report.html import Picture
from cldit.study.lab import Lab
from cldit.study.measures import Phases, mean_K, reach_m, root, tips, visible
from cldit.study.page import Page, Row
from cldit.study.pictures import Crop, maps_figure
from cldit.study.verdict import Verdict

# MPa, K of the gas, K of the walls
_CONDITIONS = (
    (0.15, 300.0, 300.0),
    (0.3, 500.0, 385.0),
    (0.6, 570.0, 455.0),
    (0.9, 620.0, 505.0),
)
_COLD = {
    "spray.time_s": 0.3e-3,
    "spray.ambient": {"pressure_Pa": 0.15e6, "temperature_K": 300.0},
    "walls.temperature_K": 300.0,
    "background.temperatures_K": [320.0, 345.0, 370.0, 395.0, 420.0],
    "camera.sensor.integration_time_s": 25e-6,
    "plan": {"shots": 19, "references": 19},
    "optics.preset": "spectral",
    "optics.compare_paper": False,
}
_OPEN_UM = (2.0, 5.0)
_CROP = Crop(-30.0, 30.0, -45.0, 5.0)
_AVOGADRO = 6.02214076e23


def open_vapour(folder: Path) -> Path:
    """A table of n-heptane's vapour from 2 to 5 um: the shipped C-H band, and nothing beside it.

    Its overtones near 2.3 um, some hundredths of the band's area, are left out.
    """
    band = vapour_band("n-heptane")
    low, high = band.wavenumber_per_cm
    number = np.arange(2000.0, 5000.1, 5.0)
    inside = (number >= low) & (number <= high)
    text = []
    for row_K in (200.0, *(float(row) for row in band.rows_K)):
        values = np.zeros(len(number))
        values[inside] = band.absorption_m2_mol(number[inside], row_K) * 1e4 / _AVOGADRO
        head = f"{'n-heptane':>20}{number[0]:10.3f}{number[-1]:10.3f}{len(number):7d}{row_K:7.1f}"
        cells = [f"{value:10.3E}" for value in values]
        rows = ["".join(cells[at : at + 10]) for at in range(0, len(cells), 10)]
        text += [f"{head}{760.0:6.1f}{values.max():10.3E}".ljust(100), *rows]
    path = folder / "tables" / "n-heptane-2-5um.xsc"
    make_folder(path.parent)
    content = "\n".join(text) + "\n"
    if not path.is_file() or path.read_text(encoding="ascii") != content:
        write_text(path, content)
    return path


def _scene(lab: Lab, *, pressure_MPa: float, gas_K: float, walls_K: float) -> Scene:
    name = "gdi" if pressure_MPa == 0.6 else f"gdi-{pressure_MPa:g}MPa-{gas_K:g}K"
    ambient = {"pressure_Pa": pressure_MPa * 1e6, "temperature_K": gas_K}
    return lab.gdi(name, {"spray.ambient": ambient, "walls.temperature_K": walls_K})


def _row(case: str, run: Run, walls_K: float) -> Row:
    errors = run.maps.apparent_temperature_standard_error_K[visible(run)]
    return {
        "case": case,
        "walls / K": walls_K,
        "reach / mm": reach_m(run) * 1e3,
        "T_app below the nozzle / K": mean_K(run, root(run)),
        "T_app at the tips / K": mean_K(run, tips(run)),
        "largest emissivity": float(np.nanmax(run.maps.emissivity)),
        "median standard error / K": float(np.nanmedian(errors)) if errors.size else float("nan"),
    }


def study(lab: Lab) -> Page:
    """Four conditions at one wavelength; the coldest through the filter and without it."""
    runs = {
        f"{MPa:g} MPa, {gas_K:g} K": lab.run(
            _scene(lab, pressure_MPa=MPa, gas_K=gas_K, walls_K=walls_K)
        )
        for MPa, gas_K, walls_K in _CONDITIONS
    }
    filtered = lab.run(lab.gdi("cold-filter", _COLD))
    unfiltered = lab.run(
        lab.gdi(
            "cold-open",
            {
                **_COLD,
                "optics.filter_um": list(_OPEN_UM),
                "optics.vapour": str(open_vapour(lab.runs.cache)),
            },
        )
    )
    wide = {"filter 3.3 to 3.5 µm": filtered, "no filter, 2 to 5 µm": unfiltered}
    walls = [row[2] for row in _CONDITIONS] + [300.0, 300.0]
    rows = [
        _row(name, run, wall)
        for (name, run), wall in zip({**runs, **wide}.items(), walls, strict=True)
    ]
    at = {row[0]: run for row, run in zip(_CONDITIONS, runs.values(), strict=True)}
    seen = {name: visible(run) for name, run in wide.items()}
    contrast = {name: mean_K(run, root(run)) - mean_K(run, tips(run)) for name, run in wide.items()}
    on, off = wide
    return Page(
        name="conditions",
        title="Pressure and temperature, with and without filter",
        figure="Figs. 7 and 8",
        text=_text(wide, rows),
        pictures={
            "maps": Picture(
                maps_figure(runs, title="DIT over pressure and temperature", columns=2),
                "0.95 ms after start of injection, fuel 370 K; one wavelength as in the paper.",
            ),
            "filter": Picture(
                maps_figure(wide, title="0.15 MPa, 300 K, 0.3 ms", crop=_CROP),
                "Integrated over the filter, and over all that the sensor sees without it.",
            ),
        },
        table=rows,
        verdicts=(
            Verdict(
                claim="Penetration falls with pressure and temperature "
                "(0.9 MPa 620 K over 0.15 MPa 300 K)",
                value=reach_m(at[0.9]) / reach_m(at[0.15]),
                high=0.9,
            ),
            Verdict(
                claim="It falls at every step (largest ratio of neighbours)",
                value=max(
                    reach_m(at[after]) / reach_m(at[before])
                    for before, after in ((0.15, 0.3), (0.3, 0.6), (0.6, 0.9))
                ),
                high=1.0,
                why="0.3 MPa at 500 K is hardly denser than 0.15 MPa at 300 K, and its vapour is "
                "seen further",
            ),
            Verdict(
                claim="Vapour around the plumes is very close to the gas's temperature "
                "(T_app where there is vapour only, minus 570 K, 0.6 MPa)",
                value=mean_K(at[0.6], Phases.of(at[0.6]).vapour_only) - 570.0,
                unit="K",
                low=-20.0,
                high=5.0,
                why="vapour that absorbs enough to be seen has mixed with a few times its mass of "
                f"gas, and cooled it; of its pixels {_near(at[0.6], 570.0):.0f} % are within 20 K "
                "of the gas",
            ),
            Verdict(
                claim="Raised temperature below the injector clearly seen with the filter, hardly "
                "without (contrast root to tips: with minus without)",
                value=contrast[on] - contrast[off],
                unit="K",
                low=1.0,
            ),
            Verdict(
                claim="Without the filter T_app lies nearer the walls' (mean distance from 300 K: "
                "with minus without)",
                value=abs(mean_K(filtered, seen[on]) - 300.0)
                - abs(mean_K(unfiltered, seen[off]) - 300.0),
                unit="K",
                low=0.0,
            ),
            Verdict(
                claim="With the filter the picture is grainy (median standard error of T_app: with "
                "over without)",
                value=float(rows[-2]["median standard error / K"])
                / float(rows[-1]["median standard error / K"]),
                low=2.0,
            ),
        ),
    )


def _near(run: Run, gas_K: float) -> float:
    """Per cent of the pixels of vapour alone that are within 20 K of the gas."""
    seen = run.maps.apparent_temperature_K[Phases.of(run).vapour_only]
    return 100.0 * float(np.mean(np.abs(seen - gas_K) < 20.0)) if seen.size else float("nan")


def _text(wide: dict[str, Run], rows: list[Row]) -> str:
    away = [abs(mean_K(run, visible(run)) - 300.0) for run in wide.values()]
    noise = [float(row["median standard error / K"]) for row in rows[-2:]]
    return (
        "Above, one spray and one trace for every condition. Below, the coldest condition through "
        "the C-H filter and without it, both integrated over the wavelengths; beside the C-H band "
        "the vapour is taken as transparent, its overtones near 2.3 µm left out. Without the "
        "filter most of the light lies where the liquid hardly absorbs: droplets scatter it, and "
        f"T_app lies {away[1]:.1f} K from the walls' 300 K on average, with the filter "
        f"{away[0]:.1f} K. There is so much more light that the median standard error is "
        f"{noise[1]:.2g} K instead of {noise[0]:.2g} K. The paper measured without the filter and "
        "simulated at 3.4 µm only. Walls are taken 115 K below the gas where it is hot, as at 0.6 "
        "MPa in the paper."
    )
