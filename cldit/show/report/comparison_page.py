"""Page of a comparison: maps of both, their difference, regions, profiles; tables as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, fields
from itertools import takewhile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from cldit.comparison.compare import Comparison
from cldit.comparison.difference import Difference, RegionDifference
from cldit.io.files import make_folder, write_text
from cldit.io.text_tables import csv_text
from cldit.show.figures.colours import CHANGE, TEMPERATURE, robust_limits
from cldit.show.figures.panels import Frame, Panel, panels_figure, window_around
from cldit.show.figures.style import png_of, write_figure
from cldit.show.page import Block, Bullets, Figure, Page, Section, Table, write_page

PAGE, REGIONS = "report.html", "regions.csv"
_RESIDUAL = 4.0  # standard errors at the ends of the colours


def comparison_figure(found: Difference) -> Drawing:
    """T_app of both, their difference, and the residuals in standard errors."""
    one, other = found.seen
    warm = [each.maps.apparent_temperature_K for each in found.seen]
    visible = np.isfinite(found.residuals)
    both = np.concatenate([image[visible] for image in warm])
    limits = robust_limits(both) if both.size else None
    change = np.where(visible, found.change_K, np.nan)
    most = float(np.percentile(np.abs(change[visible]), 99)) if both.size else 1.0
    frame = Frame(pixel_m=one.pixel_m, centre_m=one.centre_m)
    panels = [
        Panel(image, name, "T_app / K", limits=limits, colours=TEMPERATURE)
        for image, name in zip(warm, _ends_apart(one.name, other.name), strict=True)
    ]
    panels += [
        Panel(change, "difference", "change of T_app / K", limits=(-most, most), colours=CHANGE),
        Panel(
            found.residuals,
            "residual",
            "standard errors",
            limits=(-_RESIDUAL, _RESIDUAL),
            colours=CHANGE,
        ),
    ]
    window = window_around(np.where(visible, one.maps.emissivity, 0.0), frame)
    return panels_figure(panels, frame, title=found.verdict, window=window)


def _ends_apart(one: str, other: str) -> tuple[str, str]:
    """Two names of folders, without what they have in common at their beginning."""
    parts = [Path(name).parts for name in (one, other)]
    same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(*parts, strict=False)))
    first, second = ("/".join(each[same:]) or each[-1] for each in parts)
    return first, second


def write_comparison(found: Comparison, folder: Path, *, suffix: str = ".png") -> list[Path]:
    """Writes the page of a comparison, `regions.csv` and the figure of each difference, as .png,
    .pdf or .svg, into a folder; returns the paths of figures and page.
    """
    make_folder(folder)
    write_text(folder / REGIONS, regions_csv(found.differences))
    content: list[Block] = []
    written: list[Path] = []
    for number, each in enumerate(found.differences, start=1):
        drawn = comparison_figure(each)
        name = "difference" if number == 1 else f"difference-{number}"
        written.append(write_figure(drawn, folder / f"{name}{suffix}"))
        content.append(Section(f"{each.other} minus {each.one}", _sections(each, png_of(drawn))))
    return [*written, write_page(Page("Comparison", content), folder / PAGE)]


def _sections(found: Difference, png: bytes) -> list[Block]:
    figure = Figure(
        png,
        "Apparent temperature of both, their difference, and the difference in standard errors, "
        "less the errors of all pixels that fit best.",
    )
    large = [[one.name, f"{one.size:+.3g} times"] for one in found.modes]
    return [
        found.verdict,
        figure,
        Table(
            ("region", "RMS", "mean", "chi-square", "p", "pixels"),
            [[name, *region.cells] for name, region in found.regions.items()],
        ),
        Table(
            ("shape", found.one, found.other),
            [
                [name, *(f"{value:.4g} ± {error:.2g}" for value, error in values)]
                for name, values in found.shapes.items()
            ],
        ),
        Table(("error that all pixels share", "size that fits best, of the stated one"), large),
        Bullets([key.text for key in found.keys]),
    ]


def regions_csv(differences: Sequence[Difference]) -> str:
    """Table of all regions of all differences."""
    names = [one.name for one in fields(RegionDifference)]
    rows = (
        [each.one, each.other, name, *astuple(region)]
        for each in differences
        for name, region in each.regions.items()
    )
    return csv_text(["one", "other", "region", *names], rows)
