"""Curves of a run or an evaluation: budget of the error, spectrum, profile along a line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from cldit.accuracy.errors import Errors
from cldit.dit.profile import Profile
from cldit.run import Run
from cldit.show.figures.sheet import figure_of, plain


def budget_figure(
    kelvin: Mapping[str, float | None], *, title: str, total_K: float | None
) -> Figure:
    """Bars of the error of T_app by cause.

    Args:
        kelvin: of each cause; None: unknown, shown in words.
        title: above.
        total_K: of all together, a line; None: none is known.
    """
    figure = figure_of(6.2, 1.2 + 0.32 * max(len(kelvin), 1))
    axes = figure.subplots()
    names = list(kelvin)
    sizes = [kelvin[name] or 0.0 for name in names]
    axes.barh(range(len(names)), sizes, color="C0")
    for at, name in enumerate(names):
        error_K = kelvin[name]
        text = "unknown" if error_K is None else f"{error_K:.2g} K"
        axes.annotate(text, (sizes[at], at), xytext=(4, 0), textcoords="offset points",
                      va="center", fontsize=8)  # fmt: skip
    axes.set_yticks(range(len(names)), [plain(name) for name in names])
    axes.invert_yaxis()
    axes.margins(x=0.18)
    axes.set_xlabel("error of apparent temperature / K")
    if total_K is not None:
        axes.axvline(total_K, color="C3", lw=1.2, label=f"all together: {total_K:.2g} K")
        axes.legend(fontsize=8, loc="lower right")
    axes.set_title(plain(title), fontsize="medium")
    return figure


def errors_by_cause(errors: Errors) -> dict[str, float | None]:
    """The error of each cause of `errors`, K, by its name."""
    return {cause.name: cause.error_K for cause in errors.causes}


def spectrum_figure(run: Run, *, title: str) -> Figure:
    """What the spray hides of the background at each wavelength, in the mean over its pixels, and
    the light of the background behind it.

    Args:
        run: whose nodes stand for the parts of the filter.
        title: above.
    """
    quadrature = run.quadrature
    with np.errstate(divide="ignore", invalid="ignore"):
        hidden = 1.0 - np.array(
            [one.background / run.reference.background for one in run.spectral], np.float64
        )
    spray = np.isfinite(hidden).all(axis=0) & (np.nanmax(hidden, axis=0, initial=0.0) > 0.01)
    mean = hidden[:, spray].mean(axis=1) if spray.any() else np.zeros(len(hidden))
    edges = np.array(quadrature.edges_um)
    light = quadrature.light / np.diff(edges)
    figure = figure_of(6.2, 3.4)
    axes = figure.subplots()
    axes.stairs(light / light.max(), edges, fill=True, color="0.88",
                label=f"light of a black body at {quadrature.reference_K:g} K")  # fmt: skip
    members = np.array(quadrature.members)
    axes.stairs(members.T @ mean, edges, baseline=None, color="C3", lw=1.4,
                label=f"emissivity, mean of {int(spray.sum())} pixels")  # fmt: skip
    axes.set_xlabel("wavelength / µm")
    axes.set_ylabel("share")
    axes.set_ylim(0.0, 1.05)
    axes.set_title(plain(title), fontsize="medium")
    axes.legend(fontsize=8)
    return figure


def profile_figure(profile: Profile, *, title: str) -> Figure:
    """T_app and emissivity along a line, bands of one standard error.

    Args:
        profile: the values.
        title: above.
    """
    figure = figure_of(6.2, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    along = 1e3 * profile.distance_m
    for axes, value, error, label, colour in (
        (upper, profile.apparent_temperature_K, profile.apparent_temperature_standard_error_K,
         "T_app / K", "C3"),
        (lower, profile.emissivity, profile.emissivity_standard_error, "emissivity", "C0"),
    ):  # fmt: skip
        axes.plot(along, value, color=colour)
        axes.fill_between(along, value - error, value + error, color=colour, alpha=0.25, lw=0)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    beside = upper.secondary_yaxis(
        "right", functions=(lambda kelvin: kelvin - 273.15, lambda degrees: degrees + 273.15)
    )
    beside.set_ylabel("°C")
    lower.set_xlabel("distance from the start / mm")
    upper.set_title(plain(title), fontsize="medium")
    return figure
