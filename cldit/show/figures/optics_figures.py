"""Figure of a scene's optical properties: liquid, droplets, sizes, vapour, camera."""

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cldit.arrays import Floats
from cldit.constants import LIGHT_SPEED_m_s, SECOND_RADIATION_CONSTANT_m_K
from cldit.optics.response import Response
from cldit.scene.sizes import Monodisperse
from cldit.show.figures.style import WIDTH_IN, figure_of, plain, styled
from cldit.show.report.optics_summary import FIG4, PAPER, SceneOptics
from cldit.spray.sizes import density_per_m, mean_diameter_m

_BLUE, _RED, _GREEN, _GREY, _BLACK = "#1f5fa8", "#c0392b", "#2e8b57", "#8a8a8a", "#222222"
_FILTER = "#f3e3b3"


@styled
def optics_figure(data: SceneOptics) -> Figure:
    """Figure of six panels; those of droplets are omitted if the scene has none."""
    droplets = data.droplets is not None
    panels = [_vapour, *([_growth] if data.growth else []), _camera]
    if droplets:
        panels = [_index, _efficiencies, _phase, _sizes, *panels]
    columns = 2 if len(panels) % 2 == 0 else 3
    rows = -(-len(panels) // columns)
    figure = figure_of(WIDTH_IN, 0.3 + 3.1 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    for axes, panel in zip(grid, panels, strict=False):
        panel(axes, data)
        axes.grid()
        axes.set_title(fill(axes.get_title(), 84 // columns))
        short = max(len(label) for label in axes.get_legend_handles_labels()[1]) < 12
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False, ncols=3 if short else 1
        )
    figure.suptitle(f"Optics of {plain(data.scene.name)}")
    return figure


def _shade(axes: Axes, data: SceneOptics) -> None:
    low, high = data.filter_um
    axes.axvspan(low, high, color=_FILTER, zorder=0, label="filter", linewidth=0)


def _around(data: SceneOptics) -> Floats:
    """Wavelengths to draw: the filter and as much again on both sides, at least 0.35 um of it."""
    low, high = data.filter_um
    beyond = max(0.35, high - low)
    return np.linspace(max(low - beyond, 0.2), high + beyond, 1200)


def _inside(wavelength: Floats, limits: tuple[float, float]) -> Floats:
    return wavelength[(wavelength >= limits[0]) & (wavelength <= limits[1])]


def _index(axes: Axes, data: SceneOptics) -> None:
    """Paper Fig. 3a, with the sources' data; k to the right."""
    optics = data.scene.optics
    right_axes = axes.twinx()
    _shade(axes, data)
    if data.liquid is not None:
        wavelength = _inside(_around(data), data.liquid.wavelength_um)
        n, k = data.liquid.index(wavelength, data.fuel_K)
        axes.plot(wavelength, n, color=_BLUE, label=f"n, {data.liquid.name}")
        right_axes.plot(wavelength, k, color=_RED, label=f"k, {data.liquid.name}")
        title = f"liquid at {data.fuel_K:.0f} K ({data.liquid.status})"
    else:
        title = "liquid"
    axes.plot(optics.wavelength_um, optics.n, "o", color=_BLUE, mec="white")
    right_axes.plot(optics.wavelength_um, optics.k, "o", color=_RED, mec="white")
    axes.plot([], [], "o", color=_GREY, label=f"in the scene: {optics.n:g} - {optics.k:g}i")
    axes.plot(PAPER.wavelength_um, PAPER.n, "x", color=_BLACK,
              label=f"paper: {PAPER.n} - {PAPER.k}i")  # fmt: skip
    right_axes.plot(PAPER.wavelength_um, PAPER.k, "x", color=_BLACK)
    axes.plot([], [], color=_RED, label="k (right)")
    axes.set(xlabel="wavelength / µm", ylabel="n", title=title)
    right_axes.set_ylabel("k")
    right_axes.set_ylim(0, 1.2 * right_axes.get_ylim()[1])
    axes.yaxis.label.set_color(_BLUE)
    right_axes.yaxis.label.set_color(_RED)


def _efficiencies(axes: Axes, data: SceneOptics) -> None:
    """Paper Fig. 3b."""
    d = np.geomspace(1e-7, 1e-4, 1500)
    styles = [(data.droplets, "-", "scene"), (data.measured, "--", "data over the filter")]
    for droplets, style, name in styles:
        if droplets is None:
            continue
        table = droplets.table
        q_ext, q_sca, _ = table.efficiencies(d)
        values = ((q_ext, _BLACK, "ext"), (q_sca, _BLUE, "sca"), (q_ext - q_sca, _RED, "abs"))
        for value, colour, process in values:
            label = f"$Q_{{{process}}}$" if style == "-" else None
            axes.semilogx(d * 1e6, value, style, color=colour, label=label)
        axes.plot([], [], style, color=_GREY, label=f"{name}: {table.n:.3f} - {table.k:.4f}i")
    axes.axhline(2.0, color=_GREY, linewidth=0.8, linestyle=":")
    axes.set(
        xlabel="diameter / µm",
        ylabel="cross section over geometric",
        title=f"droplets at {data.scene.optics.wavelength_um:g} µm",
        xlim=(0.1, 100),
        ylim=(0, None),
    )


def _phase(axes: Axes, data: SceneOptics) -> None:
    curves = ((data.droplets, _BLUE, "scene"), (data.measured, _RED, "data over the filter"))
    for droplets, colour, name in curves:
        if droplets is not None:
            phase = droplets.phase
            angle = np.degrees(np.arccos(phase.cosine))
            label = f"{name}, g = {phase.asymmetry:.3f}"
            axes.semilogy(angle, phase.density_per_sr, color=colour, label=label)
    axes.axhline(1 / (4 * np.pi), color=_GREY, linestyle="--", label="isotropic (paper)")
    axes.set(
        xlabel="scattering angle / degrees",
        ylabel="phase function / (1/sr)",
        title="phase function, mean over the scene's sizes",
        xlim=(0, 180),
    )


def _sizes(axes: Axes, data: SceneOptics) -> None:
    """Paper Fig. 4: by number full, by mass dashed."""
    d = np.linspace(0.01e-6, 30e-6, 600)
    shown = [(data.sizes, _RED, 2.4, "scene")] if data.sizes is not None else []
    rows = list(zip(FIG4, (_BLUE, _GREEN, _BLACK, _GREY), strict=True))
    shown += [(row.sizes, colour, 1.1, "paper") for row, colour in rows]
    for sizes, colour, width, whose in shown:
        d32 = mean_diameter_m(sizes, 3, 2) * 1e6
        if isinstance(sizes, Monodisperse):
            label = f"{whose}: {sizes.diameter_um:g} µm"
            axes.axvline(sizes.diameter_um, color=colour, linewidth=width, label=label)
            continue
        label = f"{whose}: {_named(sizes)}, $D_{{32}}$ = {d32:.2f} µm"
        mass = density_per_m(sizes, d, by="mass") * 1e-6
        if whose == "scene":
            axes.fill_between(d * 1e6, mass, color=colour, alpha=0.12, linewidth=0)
            axes.plot(d * 1e6, mass, color=colour, linewidth=width, label=f"{label}, by mass")
        else:
            number = density_per_m(sizes, d, by="number") * 1e-6
            axes.plot(d * 1e6, number, color=colour, linewidth=width, label=label)
            axes.plot(d * 1e6, mass, color=colour, linewidth=width, linestyle="--")
    axes.set(
        xlabel="diameter / µm",
        ylabel="share / (1/µm)",
        title="sizes at the nozzle (dashed: by mass)",
        xlim=(0, 30),
        ylim=(0, None),
    )


def _named(sizes: object) -> str:
    values = sizes.model_dump() if hasattr(sizes, "model_dump") else {}
    short = {key: value for key, value in values.items() if isinstance(value, float)}
    return ", ".join(f"{key.removesuffix('_um')} = {value:g}" for key, value in short.items())


def _vapour(axes: Axes, data: SceneOptics) -> None:
    optics = data.scene.optics
    _shade(axes, data)
    for band, colour in zip(data.vapours, (_BLUE, _GREEN), strict=False):
        low, high = band.wavenumber_per_cm
        wavelength = _inside(_around(data), (1e4 / high, 1e4 / low))
        value = band.absorption_m2_mol(1e4 / wavelength, data.gas_K) * 1e4
        area = f"{band.area_km_mol(data.gas_K):.0f} km/mol"
        label = f"{band.species}: {area} ({band.status})"
        axes.plot(wavelength, value / 1e5, color=colour, label=label)
    used = optics.vapour_m2_mol / 10.0
    label = f"in the scene: {used:g}"
    axes.plot(optics.wavelength_um, used, "o", color=_RED, mec="white", label=label)
    if any(band.species.startswith("n-heptane") for band in data.vapours):
        paper = PAPER.vapour_m2_mol / 10.0
        axes.plot(PAPER.wavelength_um, paper, "x", color=_BLACK, label=f"paper: {paper:g}")
    axes.set(
        xlabel="wavelength / µm",
        ylabel="absorption / ($10^5$ cm²/mol)",
        title=f"vapour at {data.gas_K:.0f} K (mean over the lines)",
    )
    axes.set_ylim(0, 1.35 * axes.get_ylim()[1])


def _growth(axes: Axes, data: SceneOptics) -> None:
    """Effect of spectral lines: light between them is never absorbed."""
    for curve in data.growth:
        column, label = curve.column_mol_m2, f"{curve.species}, lines at the scene's pressure"
        axes.semilogx(column, curve.emissivity, color=_BLUE, label=label)
        label = "Beer-Lambert on the mean"
        axes.semilogx(column, curve.beer, color=_GREY, linestyle="--", label=label)
    axes.axhline(0.3, color=_RED, linewidth=1.0, linestyle=":", label="most in the paper's jet")
    axes.set(
        xlabel="column / (mol/m²)",
        ylabel="emissivity through the filter",
        title=f"curve of growth at {data.gas_K:.0f} K",
        ylim=(0, 1),
    )


def _camera(axes: Axes, data: SceneOptics) -> None:
    """Electrons from black bodies per wavelength, within the filter and around it."""
    _shade(axes, data)
    wavelength = _around(data)
    metre = wavelength * 1e-6
    stated = data.scene.camera.sensor.quantum_efficiency
    curve = not isinstance(stated, float)
    efficiency = (
        np.full(wavelength.shape, stated)
        if isinstance(stated, float)
        else Response(stated).at(wavelength)
    )
    temperatures = [t for t in data.scene.background.temperatures_K if t > 0]
    drawn = temperatures if len(temperatures) <= 6 else temperatures[:: -(-len(temperatures) // 6)]
    low, high = data.filter_um
    for place, temperature in enumerate(drawn):
        x = SECOND_RADIATION_CONSTANT_m_K / (metre * temperature)
        photons = efficiency * 2 * LIGHT_SPEED_m_s / metre**4 * np.exp(-x) / -np.expm1(-x) * 1e-6
        shade = 0.25 + 0.65 * place / max(len(drawn) - 1, 1)
        colour = (shade, 0.15, 1 - shade)
        within = (wavelength >= low) & (wavelength <= high)
        axes.semilogy(wavelength, photons, color=colour, linewidth=0.8, alpha=0.5)
        inside, label = (wavelength[within], photons[within]), f"{temperature:.0f} K"
        axes.semilogy(*inside, color=colour, linewidth=2.2, label=label)
    axes.set(
        xlabel="wavelength / µm",
        ylabel="electrons / (s m² sr µm)",
        title=f"signal of the backgrounds, quantum efficiency {'as given' if curve else stated}",
    )
