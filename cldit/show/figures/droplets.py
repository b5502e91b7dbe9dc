"""The life of a single droplet, as a picture."""

from __future__ import annotations

from cldit.show.figures.sheet import figure_of, png_of
from cldit.spray.droplet.follow import Life


def life_picture(life: Life, *, title: str) -> bytes:
    """PNG of d^2, temperature, speed and mass of the droplet `life` against time, below `title`."""
    figure = figure_of(9.0, 6.0)
    figure.suptitle(title)
    last = float(life.time_s[-1])
    scale, unit = next(((s, u) for s, u in ((1.0, "s"), (1e3, "ms")) if last * s >= 1), (1e6, "µs"))
    panels = (
        (life.diameter_m**2 * 1e12, "d² / µm²", True),
        (life.temperature_K, "temperature / K", False),
        (life.velocity_m_s, "velocity relative to the gas / (m/s)", False),
        (life.mass_kg / life.mass_kg[0], "mass / first mass", True),
    )
    for axes, (column, label, from_zero) in zip(
        figure.subplots(2, 2, sharex=True).flat, panels, strict=True
    ):
        axes.plot(life.time_s * scale, column, color="#1b6ca8")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.set_xlim(0, last * scale)
        if from_zero:
            axes.set_ylim(bottom=0)
    for axes in figure.axes[2:]:
        axes.set_xlabel(f"time / {unit}")
    return png_of(figure)
