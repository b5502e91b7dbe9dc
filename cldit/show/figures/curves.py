"""Figures of curves: error budget, spectrum, profile, design of a measurement, droplet."""

from collections.abc import Mapping, Sequence
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cldit.arrays import Floats
from cldit.constants import ZERO_CELSIUS_K
from cldit.dit.design import Design, Goal
from cldit.dit.profile import Profile
from cldit.run import Run
from cldit.show.figures.onto import draw_profile
from cldit.show.figures.style import WIDTH_IN, curves_of, finish, plain, plain_ticks, styled
from cldit.spray.droplet.follow import Life


@styled
def budget_figure(
    kelvin: Mapping[str, float | None], *, title: str, total_K: float | None
) -> Figure:
    """Bars of the error of T_app by cause, in kelvin, with a line at the total; None: unknown."""
    lines = max(sum(len(name) // 32 + 1 for name in kelvin), 1)
    figure, axes = curves_of(5.0, 0.8 + 0.22 * lines, title=title)
    names = list(kelvin)
    sizes = [kelvin[name] or 0.0 for name in names]
    axes.barh(range(len(names)), sizes, color="C0")
    for at, name in enumerate(names):
        error_K = kelvin[name]
        label = "unknown" if error_K is None else f"{error_K:.2g} K"
        axes.annotate(label, (sizes[at], at), xytext=(4, 0), textcoords="offset points",
                      va="center", fontsize=7, zorder=3,
                      bbox={"facecolor": "white", "lw": 0, "pad": 0.5})  # fmt: skip
    axes.set_yticks(range(len(names)), [fill(plain(name), 32) for name in names])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.25 * max([*sizes, total_K or 0.0, 1e-9]))
    axes.set_xlabel("error of apparent temperature / K")
    if total_K is not None:
        axes.axvline(total_K, color="C3", lw=1.2, label=f"all together: {total_K:.2g} K")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return figure


@styled
def spectrum_figure(run: Run, *, title: str) -> Figure:
    """Mean emissivity of the spray's pixels at each wavelength, above the background's light."""
    quadrature = run.quadrature
    with np.errstate(divide="ignore", invalid="ignore"):
        hidden = 1.0 - np.array(
            [node.background / run.reference.background for node in run.spectral], np.float64
        )
    spray = np.isfinite(hidden).all(axis=0) & (np.nanmax(hidden, axis=0, initial=0.0) > 0.01)
    mean = hidden[:, spray].mean(axis=1) if spray.any() else np.zeros(len(hidden))
    edges = np.array(quadrature.edges_um)
    light = quadrature.light / np.diff(edges)
    figure, axes = curves_of(5.0, 2.8, title=title)
    axes.stairs(light / light.max(), edges, fill=True, color="0.88",
                label=f"light of a black body at {quadrature.reference_K:g} K")  # fmt: skip
    members = np.array(quadrature.members)
    axes.stairs(members.T @ mean, edges, baseline=None, color="C3", lw=1.4,
                label=f"emissivity, mean of {int(spray.sum())} pixels")  # fmt: skip
    axes.set(xlabel="wavelength / µm", ylabel="share", ylim=(0.0, 1.05))
    axes.legend()
    return figure


@styled
def profile_figure(profile: Profile, *, title: str) -> Figure:
    """T_app and emissivity along a line, with the bands of `draw_profile`."""
    figure, (upper, lower) = curves_of(5.0, 3.8, title=title, rows=2, sharex=True)
    draw_profile(upper, profile, color="C3")
    draw_profile(lower, profile, emissivity=True, color="C0")
    upper.set_xlabel("")
    for axes in (upper, lower):
        axes.grid()
    figure.align_ylabels()
    beside = upper.secondary_yaxis(
        "right",
        functions=(
            lambda kelvin: kelvin - ZERO_CELSIUS_K,
            lambda degrees: degrees + ZERO_CELSIUS_K,
        ),
    )
    beside.set_ylabel("°C")
    return figure


@styled
def nodes_figure(errors_K: Sequence[float], *, chosen: int, title: str) -> Figure:
    """Figure of the error of T_app with 1, 2, .. wavelengths; the chosen number is marked."""
    figure, axes = curves_of(4.0, 2.8, title=title)
    numbers = np.arange(1, len(errors_K) + 1)
    shown = np.maximum(np.asarray(errors_K, float), 1e-4)  # 0 has no place on a log axis
    axes.semilogy(numbers, shown, "o-", color="C0")
    axes.plot(chosen, shown[chosen - 1], "o", color="C3", markersize=9, label="traced")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(axes, "number of wavelengths", "RMS error of apparent temperature / K", minor=True,
           legend=True)  # fmt: skip
    return figure


@styled
def design_figure(
    lines: Sequence[tuple[Design, Floats, Floats]], best: Design, goal: Goal, *, title: str
) -> Figure:
    """Figure of the error of T_app against the time of a measurement; the chosen design is marked.

    lines: design, (N,) times [s], (N,) errors [K], for each number of backgrounds.
    """
    figure, axes = curves_of(WIDTH_IN, 4.0, title=title)
    for design, time_s, error_K in sorted(lines, key=lambda line: len(line[0].backgrounds_K)):
        low, high = min(design.backgrounds_K), max(design.backgrounds_K)
        label = f"{len(design.backgrounds_K)} backgrounds, {low:g} to {high:g} K"
        (drawn,) = axes.loglog(time_s / 60.0, error_K, label=label)
        axes.plot(design.time_s / 60.0, design.error_K, "o", color=drawn.get_color())
    axes.plot(
        best.time_s / 60.0,
        best.error_K,
        "o",
        markersize=11,
        markerfacecolor="none",
        markeredgecolor="black",
        label=f"plan.yaml: {best.shots} shots, {best.references} references each",
    )
    axes.axhline(goal.error_K, color="0.35", linewidth=0.8, linestyle="--")
    axes.annotate(
        "requested",
        (1.0, goal.error_K),
        xycoords=("axes fraction", "data"),
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
        color="0.35",
    )
    plain_ticks(axes)
    lowest = min(float(errors.min()) for _, _, errors in lines)
    highest = max(float(errors.max()) for _, _, errors in lines)
    axes.set_ylim(0.8 * lowest, 1.2 * max(highest, goal.error_K))
    axes.set_xticks([20, 30, 40, 60, 100, 200, 400, 1000])
    longest = max(float(time_s[-1]) for _, time_s, _ in lines) / 60.0
    shortest = min(float(time_s[0]) for _, time_s, _ in lines) / 60.0
    axes.set_xlim(0.9 * shortest, 1.1 * longest)
    label = f"standard error of T_app / K, {100 * goal.quantile:g} % quantile"
    finish(axes, "time / min", label, minor=True, legend=True)
    return figure


Lines = Sequence[tuple[Floats, str, str]]
"""Values (N,), name in the legend, and format of matplotlib."""


@styled
def time_figure(
    time: Floats,
    unit: str,
    panels: Sequence[tuple[str, bool, Lines]],
    *,
    title: str,
    height_in: float,
    columns: int = 1,
) -> Figure:
    """Figure of quantities against time (N,), a panel for each.

    panels: label, True for an axis from 0, and lines; several lines have a legend, beside panels of
    full width. In several columns, time begins at 0.
    """
    rows = len(panels) // columns
    figure, grid = curves_of(
        WIDTH_IN, height_in, title=title, rows=rows, columns=columns, sharex=True
    )
    for number, (axes, (label, from_zero, lines)) in enumerate(
        zip(np.ravel(grid), panels, strict=True)
    ):
        for values, name, form in lines:
            axes.plot(time, values, form, label=name)
        finish(axes, unit if number >= (rows - 1) * columns else "", label)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.set(ylim=(0 if from_zero else None, None), xlim=(0 if columns > 1 else None, None))
        if len(lines) > 1:
            beside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)} if columns == 1 else {}
            axes.legend(**beside)
    figure.align_ylabels()
    return figure


def life_figure(life: Life, *, title: str) -> Figure:
    """Figure of d^2, temperature, speed and mass of a droplet against time."""
    end = float(life.time_s[-1])
    scale, unit = next(((s, u) for s, u in ((1.0, "s"), (1e3, "ms")) if end * s >= 1), (1e6, "µs"))
    mass = life.mass_kg / life.mass_kg[0]
    panels = [
        ("d² / µm²", True, [(life.diameter_m**2 * 1e12, "", "C0")]),
        ("temperature / K", False, [(life.temperature_K, "", "C0")]),
        ("velocity relative to the gas / (m/s)", False, [(life.velocity_m_s, "", "C0")]),
        ("mass / first mass", True, [(mass, "", "C0")]),
    ]
    time, label = life.time_s * scale, f"time / {unit}"
    return time_figure(time, label, panels, title=title, height_in=4.6, columns=2)
