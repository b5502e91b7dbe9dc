"""Results that commands print last: range of the maps, files, next command."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cldit.cli.console import OUT, escaped

if TYPE_CHECKING:  # loads scipy, which not every command needs
    from cldit.accuracy.errors import Errors
    from cldit.dit.maps import Maps

_REACH = (
    ("liquid_penetration_95_m", "liquid", " (95 % of its mass)"),
    ("vapour_penetration_m", "vapour", ""),
)


def print_maps(maps: "Maps", *, recorded: bool) -> None:
    """Prints T_app and emissivity of the visible spray, or the reasons why it has none.

    Ranges are percentiles 1 and 99. Without visible spray, all pixels with a T_app count.
    """
    valid = np.isfinite(maps.apparent_temperature_K)
    if not valid.any():
        reasons = "; ".join(f"{count} {reason.text}" for reason, count in maps.count().items())
        OUT.print(f"no pixel has an apparent temperature: {reasons}", style="bold")
        return
    visible, population = maps.has_temperature, "pixels with an emissivity above 0.05"
    if not visible.any():
        visible, population = valid, "pixels; none has an emissivity above 0.05"
    low, middle, high = np.percentile(maps.apparent_temperature_K[visible], (1, 50, 99))
    faint, median, dense = np.percentile(maps.emissivity[visible], (1, 50, 99))
    OUT.print(f"T_app {low:.1f} to {high:.1f} K, median {middle:.1f} K", style="bold")
    OUT.print(f"emissivity {faint:.2g} to {dense:.2g}, median {median:.2g}", style="bold")
    rows, columns = maps.reason.shape
    count = f"{int(visible.sum())} of {columns} x {rows}"
    OUT.print(f"  in {count} {'recorded' if recorded else 'traced'} {population}", style="dim")


def print_error(errors: "Errors") -> None:
    """Prints the errors of T_app and emissivity, and the largest source of each."""
    largest = errors.largest()
    by = f"; largest source: {largest.name}, {largest.text}" if largest and not errors.why else ""
    OUT.print(f"error of T_app {errors.text}{' RMS' if by else ''}{by}", style="bold")
    emissivity_cause = errors.largest(of_emissivity=True)
    if emissivity_cause is not None and not errors.why:
        by = f"; largest source: {emissivity_cause.name}, {emissivity_cause.emissivity_text}"
        OUT.print(f"error of emissivity {errors.emissivity_text} RMS{by}", style="bold")


def print_reach(figures: Mapping[str, float], errors: "Errors | None" = None) -> None:
    """Prints how far liquid and vapour of a spray with these figures reach."""
    figure_errors = {} if errors is None else errors.figures
    reach = [
        f"{phase} {1e3 * figures[key]:.1f}"
        f"{f' +- {1e3 * figure_errors[key]:.1f}' if key in figure_errors else ''} mm{share}"
        for key, phase, share in _REACH
        if figures.get(key, 0.0) > 0.0
    ]
    if reach:
        OUT.print(f"penetration: {', '.join(reach)}", style="bold")


def print_cut(maps: "Maps") -> None:
    """Prints at which edges the field cuts the visible spray."""
    visible = maps.has_temperature
    edges = {"left": visible[:, 0], "right": visible[:, -1], "top": visible[0],
             "bottom": visible[-1]}  # fmt: skip
    cut = [f"{name} ({int(edge.sum())} pixels)" for name, edge in edges.items() if edge.any()]
    if cut:
        OUT.print(f"the field cuts the visible spray at its edges: {', '.join(cut)}")


def print_files(*paths: Path) -> None:
    """Prints paths, each on a line."""
    for path in paths:
        OUT.print(escaped(str(path)))


def print_next(*words: str | Path) -> None:
    """Prints the command that is usually given next."""
    OUT.print(escaped(f"next: {shlex.join(map(str, words))}"))
