"""Page of a comparison: maps of both, their difference, regions, profiles; tables as CSV."""

from collections.abc import Sequence
from dataclasses import astuple, fields
from itertools import takewhile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from cldit.comparison.compare import Comparison
from cldit.comparison.difference import Difference
from cldit.comparison.tested import RegionDifference
from cldit.io.files import make_folder, write_text
from cldit.io.text_tables import csv_text
from cldit.show.figures.colours import TEMPERATURE, robust_limits
from cldit.show.figures.maps import change_panel
from cldit.show.figures.onto import draw_profile
from cldit.show.figures.panels import GREY, ImageFrame, Panel, panels_figure, window_around
from cldit.show.figures.style import WIDTH_IN, figure_of, plain, styled, write_figure
from cldit.show.page import Block, Bullets, Figure, Page, Section, Table, write_page

PAGE, REGIONS, PROFILES = "report.html", "regions.csv", "profiles.csv"
_FROM = {"axis": "injector's tip", "across": "axis"}
_LABELS = ("apparent temperature / K", "change / K", "emissivity", "change")


def comparison_figure(difference: Difference) -> Drawing:
    """T_app of both, their difference, and the residuals in standard errors."""
    base, changed = difference.seen
    of_t_app = difference.observable == "T_app"
    name, label = ("apparent_temperature_K", "T_app / K") if of_t_app else 2 * ("emissivity",)
    warm = [getattr(result.maps, name) for result in difference.seen]
    visible = np.isfinite(difference.residuals)
    values = np.concatenate([image[visible] for image in warm])
    limits = robust_limits(values) if values.size else None
    change = np.where(visible, difference.change, np.nan)
    top = float(np.percentile(np.abs(change[visible]), 99)) if values.size else 1.0
    frame = ImageFrame(pixel_m=base.pixel_m, centre_m=base.centre_m)
    names = _ends_apart(base.name, changed.name)
    panels = [
        *(
            Panel(image, name, label, limits, TEMPERATURE)
            for image, name in zip(warm, names, strict=True)
        ),
        change_panel(change, "difference", f"change of {label}", largest=top),
        change_panel(difference.residuals, "residual", "standard errors", largest=4.0),
    ]
    window = window_around(np.where(visible, base.maps.emissivity, 0.0), frame)
    title = "{1} minus {0}".format(*names)
    legend = [(GREY, f"no {label.partition(' /')[0]}, or not compared")]
    return panels_figure(panels, frame, title=title, window=window, legend=legend)


@styled
def profiles_figure(difference: Difference) -> Drawing:
    """T_app and emissivity of both along each line, and their changes, with bands of the errors."""
    lines = difference.profiles
    figure = figure_of(WIDTH_IN, 6.4)
    axes = figure.subplots(
        4, len(lines), sharex="col", sharey="row", squeeze=False, height_ratios=(2, 1, 2, 1)
    )
    names = [plain(name) for name in _ends_apart(*(result.name for result in difference.seen))]
    warm = []
    for column, (where, line) in zip(axes.T, lines.items(), strict=True):
        visible = np.isfinite(line.change_K)
        along = 1e3 * line.one.distance_m
        for profile, name, color in ((line.one, names[0], "C0"), (line.other, names[1], "C3")):
            for row, emissivity in ((0, False), (2, True)):
                draw_profile(column[row], profile, emissivity=emissivity, color=color)
                column[row].lines[-1].set_label(name)
                column[row].set(xlabel="", ylabel="")
            error_K = np.nan_to_num(profile.apparent_temperature_standard_error_K)
            warm += [(profile.apparent_temperature_K + sign * error_K)[visible] for sign in (-1, 1)]
        for row, change, error in (
            (1, line.change_K, line.change_error_K),
            (3, line.emissivity_change, line.emissivity_change_error),
        ):
            column[row].plot(along, change, color="0.2")
            column[row].fill_between(along, change - error, change + error, color="0.7", lw=0)
            column[row].axhline(0.0, color="0.2", lw=0.6, ls=":")
        column[0].set_title(line.title)
        if visible.any():
            beside = along[visible].min(), along[visible].max()
            wide = 0.15 * (beside[1] - beside[0]) + 1.0
            column[0].set_xlim(max(beside[0] - wide, along[0]), min(beside[1] + wide, along[-1]))
        column[-1].set_xlabel(f"distance from the {_FROM[where]} / mm")
    for row, label in zip(axes, _LABELS, strict=True):
        row[0].set_ylabel(label)
        for panel in row:
            panel.grid()
    warm_K = np.concatenate(warm)
    if warm_K.size:  # T_app of thin spray is mostly noise
        low, high = np.percentile(warm_K, (1.0, 99.0))
        margin = 0.05 * (high - low) + 0.1
        axes[0, 0].set_ylim(low - margin, high + margin)
    axes[0, 0].legend()
    figure.align_ylabels()
    return figure


def _ends_apart(base: str, changed: str) -> tuple[str, str]:
    """Two names of folders, without what they have in common at their beginning."""
    parts = [Path(name).parts for name in (base, changed)]
    same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(*parts, strict=False)))
    base_end, changed_end = ("/".join(part[same:]) or part[-1] for part in parts)
    return base_end, changed_end


def write_comparison(comparison: Comparison, folder: Path, *, suffix: str = ".png") -> list[Path]:
    """Writes the page of a comparison, `regions.csv`, `profiles.csv` and two figures of each
    difference, as .png, .pdf or .svg, into a folder; returns the paths of figures and page.
    """
    make_folder(folder)
    write_text(folder / REGIONS, regions_csv(comparison.differences))
    write_text(folder / PROFILES, profiles_csv(comparison.differences))
    content: list[Block] = []
    written: list[Path] = []
    for number, difference in enumerate(comparison.differences, start=1):
        drawn = {"difference": comparison_figure(difference)}
        if difference.profiles:
            drawn["profiles"] = profiles_figure(difference)
        ending = "" if number == 1 else f"-{number}"
        written += [
            write_figure(figure, folder / f"{name}{ending}{suffix}")
            for name, figure in drawn.items()
        ]
        images = [Figure.of(figure, _ABOUT[name]) for name, figure in drawn.items()]
        content.append(
            Section(f"{difference.other} minus {difference.one}", _sections(difference, images))
        )
    content = [*comparison.verdict.splitlines(), *content]
    return [*written, write_page(Page("Comparison", content), folder / PAGE)]


_ABOUT = {
    "difference": "Apparent temperature or emissivity of both, their difference, and the "
    "difference in standard errors, less the errors of all pixels that fit best.",
    "profiles": "Profiles along the spray's axis and across it, with bands of one standard error "
    "that the two do not share, and their changes where the spray is visible in both.",
}


def _sections(difference: Difference, figures: Sequence[Figure]) -> list[Block]:
    large = [[mode.name, f"{mode.size:+.2f}"] for mode in difference.modes]
    return [
        *difference.verdict.lines,
        *figures,
        Table(
            ("region", "RMS", "mean", "chi-square", "p", "pixels"),
            [[name, *region.cells] for name, region in difference.regions.items()],
        ),
        Table(
            ("shape", difference.one, difference.other),
            [
                [name, *(f"{value:.4g} ± {error:.2g}" for value, error in values)]
                for name, values in difference.shapes.items()
            ],
        ),
        Table(
            ("error that all pixels share", "size that fits best, in standard deviations"), large
        ),
        Bullets([key.text for key in difference.keys]),
    ]


def regions_csv(differences: Sequence[Difference]) -> str:
    """Table of all regions of all differences."""
    names = [column.name for column in fields(RegionDifference)]
    rows = (
        [difference.one, difference.other, name, *astuple(region)]
        for difference in differences
        for name, region in difference.regions.items()
    )
    return csv_text(["one", "other", "region", *names], rows)


def profiles_csv(differences: Sequence[Difference]) -> str:
    """Table of the profiles of all differences, a row for each point."""
    tables = [
        ([difference.one, difference.other, name], line.columns)
        for difference in differences
        for name, line in difference.profiles.items()
    ]
    names = list(tables[0][1]) if tables else []
    rows = (
        [*start, *(f"{value:.7g}" for value in row)]
        for start, columns in tables
        for row in zip(*columns.values(), strict=True)
    )
    return csv_text(["one", "other", "line", *names], rows)
