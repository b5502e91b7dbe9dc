"""Report of a series: figures in one scale, a film of them, a table and curves over time."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from cldit.camera.view import SensorView
from cldit.dit.maps import Maps
from cldit.io.files import make_folder, write_bytes, write_text
from cldit.io.plain_data import dump_yaml
from cldit.run.series import SeriesTime
from cldit.run.series_plan import SeriesPlan
from cldit.scene import Scene
from cldit.show.figures.colours import emissivity_scale, temperature_range_K
from cldit.show.figures.film import write_film
from cldit.show.figures.maps import map_png
from cldit.show.figures.panels import Frame
from cldit.show.figures.sheet import figure_of, plain, png_of

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
_NOTE = "white: transparent; grey: no apparent temperature for another reason"


@dataclass(frozen=True)
class Scale:
    """Colour scale of all figures: temperatures of blue and red, emissivity of full colour."""

    range_K: tuple[float, float]
    emissivity: float

    @classmethod
    def of(cls, maps: Iterable[Maps]) -> Scale:
        """Smallest scale that includes those of all maps."""
        ranges, scales = [], []
        for each in maps:
            ranges.append(temperature_range_K(each))
            scales.append(emissivity_scale(each))
        known = [(low, high) for low, high in ranges if high > low]
        if not known:
            return cls((0.0, 0.0), max(scales, default=1.0))
        return cls((min(low for low, _ in known), max(high for _, high in known)), max(scales))


def maps_of(time: SeriesTime) -> Path:
    """Folder of the maps of a time that has a run: those of its acquisition if there is one."""
    assert time.folder is not None
    acquired = time.folder / "acquisition" / "maps"
    return acquired if acquired.is_dir() else time.folder / "maps"


def table_csv(plan: SeriesPlan, times: Sequence[SeriesTime]) -> str:
    """CSV with a line for each time; unknown figures are empty."""
    first = "time_s" if plan.in_seconds else "time"
    stream = io.StringIO()
    names = [first, "state", *FIGURES, *_OF_MAPS, "folder", "problem"]
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    for each in times:
        figures = {name: f"{each.spray[name]:.9g}" for name in FIGURES if name in each.spray}
        if each.state == "no spray":
            figures |= {"liquid_mass_kg": "0", "vapour_mass_kg": "0"}
        if each.dit is not None:
            seen = {name: getattr(each.dit, name) for name in _OF_MAPS}
            figures |= {name: f"{value:.9g}" for name, value in seen.items() if value == value}
        folder = "" if each.folder is None else each.folder.name
        writer.writerow(
            {first: f"{each.time:.9g}", "state": each.state, **figures}
            | {"folder": folder, "problem": each.problem}
        )
    return stream.getvalue()


def write_series(
    plan: SeriesPlan, scene: Scene, times: Sequence[SeriesTime], out: Path
) -> list[Path]:
    """Writes table, curves, figures in one scale and film into a series' folder.

    Returns the files, `series.csv` first.
    """
    made = [out / "series.csv", out / "series.png"]
    write_text(made[0], table_csv(plan, times))
    write_bytes(made[1], curves(plan, times, title=scene.name))
    done = [each for each in times if each.state == "done"]
    if not done:
        return made
    scale = Scale.of(Maps.load(maps_of(each)) for each in done)
    shared = {"apparent_temperature_K": list(scale.range_K), "emissivity": scale.emissivity}
    make_folder(out / "pictures")
    write_text(out / "pictures" / "scale.yaml", dump_yaml(shared))
    pictures: list[bytes] = []
    for each in done:
        png = _picture(plan, scene, each, scale)
        pictures.append(png)
        write_bytes(out / "pictures" / f"{plan.folder(each.time)}.png", png)
    return [*made, out / "pictures", *write_film(out / FILM_FILE, pictures, [t.time for t in done])]


def _picture(plan: SeriesPlan, scene: Scene, time: SeriesTime, scale: Scale) -> bytes:
    place = maps_of(time)
    acquired = place.parent.name == "acquisition"
    width, height = scene.camera.field_m
    pixel_m = width / scene.camera.pixels[0], height / scene.camera.pixels[1]
    if acquired:
        pixel_m = SensorView.from_scene(scene).pixel_m
    x, _, z = scene.target_m
    return map_png(
        Maps.load(place),
        Frame(pixel_m, (x, z)),
        title=f"{scene.name}: DIT of {'acquired shots' if acquired else 'traces, without noise'}",
        range_K=scale.range_K,
        scale=scale.emissivity,
        note=_NOTE,
        stamp=plan.stamp(time.time),
    )


def curves(plan: SeriesPlan, times: Sequence[SeriesTime], *, title: str) -> bytes:
    """PNG of penetrations, masses, droplet size and apparent temperature over time.

    Times that failed are gaps.
    """
    known = [each for each in times if each.state != "failed"]
    at = np.array([each.time for each in known]) * (1e3 if plan.in_seconds else 1.0)
    figure = figure_of(8.2, 9.0)
    reach, mass, size, warm = figure.subplots(4, 1, sharex=True)

    def values(name: str, factor: float) -> NDArray[np.float64]:
        none = 0.0 if name.endswith("mass_kg") else np.nan
        return factor * np.array(
            [each.spray.get(name, none if each.state == "no spray" else np.nan) for each in known]
        )

    for percent, style in ((90, ":"), (95, "-"), (99, "--")):
        label = f"liquid, {percent} % of the mass"
        reach.plot(at, values(f"liquid_penetration_{percent}_m", 1e3), f"C0{style}o", label=label)
    reach.plot(at, values("vapour_penetration_m", 1e3), "C1-s", label="vapour, farthest 0.1 %")
    mass.plot(at, values("liquid_mass_kg", 1e6), "C0-o", label="liquid")
    mass.plot(at, values("vapour_mass_kg", 1e6), "C1-s", label="vapour")
    size.plot(at, values("sauter_mean_diameter_m", 1e6), "C0-o")
    median = [np.nan if each.dit is None else each.dit.apparent_temperature_K for each in known]
    warm.plot(at, median, "C3-o")
    for axes, label in (
        (reach, "penetration / mm"),
        (mass, "mass / mg"),
        (size, "Sauter mean diameter / µm"),
        (warm, "apparent temperature / K,\nmedian over the pixels"),
    ):
        _finish(axes, label)
    reach.set_ylim(bottom=0.0)
    mass.set_ylim(bottom=0.0)
    figure.align_ylabels()
    warm.set_xlabel("time / ms" if plan.in_seconds else "time / the case's own unit")
    figure.suptitle(plain(title), fontsize=11)
    return png_of(figure)


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    for line in axes.get_lines():
        line.set_markersize(3.5)
    if len(axes.get_lines()) > 1:
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
