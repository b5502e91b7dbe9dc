"""Report of a series: figures in one scale, a film of them, a table and curves over time."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cldit.arrays import Floats
from cldit.dit.maps import Maps
from cldit.io.files import make_folder, write_text
from cldit.io.plain_data import dump_yaml
from cldit.io.text_tables import csv_text
from cldit.run.series import SeriesTime
from cldit.run.series_plan import SeriesPlan
from cldit.scene import Scene
from cldit.show.figures.colours import Scale
from cldit.show.figures.curves import time_figure
from cldit.show.figures.film import write_film
from cldit.show.figures.maps import frame_of, map_figure, spray_window
from cldit.show.figures.panels import ImageFrame, Window, joined
from cldit.show.figures.style import SCREEN_DPI, png_of, write_figure

# Notes of a spray that become columns.
FIGURES = (
    "liquid_mass_kg",
    "vapour_mass_kg",
    "sauter_mean_diameter_m",
    "liquid_penetration_90_m",
    "liquid_penetration_95_m",
    "liquid_penetration_99_m",
    "vapour_penetration_m",
)
FILM_FILE = "film.gif"
_OF_MAPS = ("pixels", "apparent_temperature_K", "emissivity")


def maps_of(time: SeriesTime) -> Path:
    """Folder of the maps of a time that has a run: those of its acquisition if there is one."""
    assert time.folder is not None
    acquired = time.folder / "acquisition" / "maps"
    return acquired if acquired.is_dir() else time.folder / "maps"


def table_csv(plan: SeriesPlan, times: Sequence[SeriesTime]) -> str:
    """CSV with a line for each time; unknown figures are empty."""
    time_name = "time_s" if plan.in_seconds else "time"
    names = [time_name, "state", *FIGURES, *_OF_MAPS, "folder", "problem"]
    rows = []
    for time in times:
        figures = {name: f"{time.spray[name]:.9g}" for name in FIGURES if name in time.spray}
        if time.state == "no spray":
            figures |= {"liquid_mass_kg": "0", "vapour_mass_kg": "0"}
        if time.dit is not None:
            seen = {name: getattr(time.dit, name) for name in _OF_MAPS}
            figures |= {name: f"{value:.9g}" for name, value in seen.items() if value == value}
        folder = "" if time.folder is None else time.folder.name
        figures |= {time_name: f"{time.time:.9g}", "state": time.state}
        figures |= {"folder": folder, "problem": time.problem}
        rows.append([figures.get(name, "") for name in names])
    return csv_text(names, rows)


def write_series(
    plan: SeriesPlan,
    scene: Scene,
    times: Sequence[SeriesTime],
    out: Path,
    *,
    suffix: str = ".png",
) -> list[Path]:
    """Writes table, curves, figures in one scale and film into a series' folder.

    suffix: of the figures: .png, .pdf or .svg. Returns the files, `series.csv` first.
    """
    files = [out / "series.csv", out / f"series{suffix}"]
    write_text(files[0], table_csv(plan, times))
    write_figure(curves(plan, times, title=scene.name), files[1])
    done = [time for time in times if time.state == "done"]
    if not done:
        return files
    windows: list[Window] = []
    reasons: set[int] = set()

    def loaded() -> Iterator[Maps]:  # one after the other: a long series exceeds the memory
        for time in done:
            maps = Maps.load(maps_of(time))
            windows.append(spray_window(maps, _frame(scene, time)))
            reasons.update(maps.count())
            yield maps

    scale = Scale.of(loaded())
    shared = {"apparent_temperature_K": list(scale.range_K), "emissivity": scale.emissivity}
    make_folder(out / "pictures")
    write_text(out / "pictures" / "scale.yaml", dump_yaml(shared))
    shown: list[bytes] = []
    for time in done:
        source = "acquired" if _acquired(time) else "traced, without noise"
        figure = map_figure(
            Maps.load(maps_of(time)),
            _frame(scene, time),
            title=f"{scene.name}: {source}",
            vmin=scale.range_K[0],
            vmax=scale.range_K[1],
            scale=scale.emissivity,
            window=joined(windows),
            reasons=reasons,
            stamp=plan.stamp(time.time),
        )
        write_figure(figure, out / "pictures" / f"{plan.folder(time.time)}{suffix}")
        shown.append(png_of(figure, dpi=SCREEN_DPI))
    return [*files, out / "pictures", *write_film(out / FILM_FILE, shown, [t.time for t in done])]


def _acquired(time: SeriesTime) -> bool:
    return maps_of(time).parent.name == "acquisition"


def _frame(scene: Scene, time: SeriesTime) -> ImageFrame:
    return frame_of(scene, sensor=_acquired(time))


def curves(plan: SeriesPlan, times: Sequence[SeriesTime], *, title: str) -> Figure:
    """Figure of penetrations, masses, droplet size and apparent temperature over time.

    Times that failed are gaps.
    """
    evaluated = [time for time in times if time.state != "failed"]

    def values(name: str, factor: float) -> Floats:
        none = 0.0 if name.endswith("mass_kg") else np.nan
        return factor * np.array(
            [
                time.spray.get(name, none if time.state == "no spray" else np.nan)
                for time in evaluated
            ]
        )

    penetrations = [
        (values(f"liquid_penetration_{percent}_m", 1e3), f"liquid, {percent} % of the mass", style)
        for percent, style in ((90, "C0:o"), (95, "C0-o"), (99, "C0--o"))
    ]
    vapour = (values("vapour_penetration_m", 1e3), "vapour, farthest 0.1 %", "C1-s")
    masses = [
        (values("liquid_mass_kg", 1e6), "liquid", "C0-o"),
        (values("vapour_mass_kg", 1e6), "vapour", "C1-s"),
    ]
    median = [np.nan if time.dit is None else time.dit.apparent_temperature_K for time in evaluated]
    warm = "apparent temperature / K,\nmedian over the pixels"
    size = values("sauter_mean_diameter_m", 1e6)
    panels = [
        ("penetration / mm", True, [*penetrations, vapour]),
        ("mass / mg", True, masses),
        ("Sauter mean diameter / µm", False, [(size, "", "C0-o")]),
        (warm, False, [(np.array(median), "", "C3-o")]),
    ]
    at = np.array([time.time for time in evaluated]) * (1e3 if plan.in_seconds else 1.0)
    label = "time / ms" if plan.in_seconds else "time / the case's own unit"
    return time_figure(at, label, panels, title=title, height_in=7.5)
