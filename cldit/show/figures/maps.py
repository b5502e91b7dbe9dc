"""Figures of maps, weights, shares, camera images and errors, with axes in mm."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cldit.dit.maps import Maps, Reason
from cldit.radiance.weights import Weights, compose
from cldit.show.figures.colours import (
    emissivity_scale,
    map_colours,
    pixel_colours,
    temperature_range_K,
)
from cldit.show.figures.panels import (
    Frame,
    Panel,
    aspect_of,
    axes_mm,
    draw,
    draw_key,
    robust_limits,
)
from cldit.show.figures.sheet import plain, png_of, sheet


def _explained(maps: Maps) -> str:
    """Meaning of white and grey in these maps, with the number of pixels; empty without any."""
    count = maps.count()
    lines = []
    if clear := count.get(Reason.EMISSIVITY_TOO_LOW, 0):
        lines.append(f"white: transparent, no apparent temperature ({clear} pixels)")
    grey = [
        f"{reason.text} ({number})"
        for reason, number in count.items()
        if reason not in (Reason.OK, Reason.EMISSIVITY_TOO_LOW)
    ]
    if grey:
        lines += textwrap.wrap("grey: " + "; ".join(grey), 100)
    return "\n".join(lines)


def map_png(maps: Maps, frame: Frame, *, title: str, **options: Any) -> bytes:
    """PNG of `map_figure` of `maps` (H, W) in `frame`, under a `title`, with its `options`."""
    return png_of(map_figure(maps, frame, title=title, **options))


def map_figure(
    maps: Maps,
    frame: Frame,
    *,
    title: str,
    range_K: tuple[float, float] | None = None,
    scale: float | None = None,
    note: str | None = None,
    stamp: str = "",
) -> Figure:
    """Figure of both maps (H, W): hue is apparent temperature, saturation emissivity.

    The colouring of the paper (Section 3). Pixels without a temperature are white where the spray
    is transparent, and light grey for any other reason.

    Args:
        range_K: temperatures of blue and red; None: percentiles, see `temperature_range_K`.
        scale: emissivity of full saturation; None: see `emissivity_scale`.
        note: small print; None: the meaning of white and grey in these maps.
        stamp: text in the upper left corner of the image, such as its time.
    """
    chosen_K = temperature_range_K(maps) if range_K is None else range_K
    full = emissivity_scale(maps) if scale is None else scale
    shape = maps.emissivity.shape
    figure, [place] = sheet(
        [""],
        aspect=aspect_of(frame, shape),
        heading=title,
        width_in=5.4,
        gap_in=0.3,
        key_in=0.85,
        note=_explained(maps) if note is None else note,
    )
    axes, key = place.image, place.key
    axes.imshow(
        pixel_colours(maps, range_K=chosen_K, scale=full),
        extent=frame.extent_mm(shape),
        interpolation="nearest",
        aspect="auto",
    )
    axes_mm(axes, frame, shape)
    if stamp:
        axes.text(
            0.03,
            0.97,
            plain(stamp),
            transform=axes.transAxes,
            ha="left",
            va="top",
            fontsize=13,
            family="monospace",
            bbox={"boxstyle": "round,pad=0.25", "facecolor": "white", "alpha": 0.85, "lw": 0.5},
        )
    low, high = chosen_K
    if high > low:
        warm, there = np.meshgrid(np.linspace(high, low, 240), np.linspace(0, full, 60))
        key.imshow(
            map_colours(there.T, warm.T, range_K=chosen_K, scale=full),
            extent=(0.0, full, low, high),
            aspect="auto",
        )
        key.yaxis.tick_right()
        key.yaxis.set_label_position("right")
        key.set_ylabel("apparent temperature / K")
        key.set_xlabel("emissivity")
        key.set_xticks([0.0, full], ["0", f"{full:g}"])
    else:
        key.set_axis_off()
        key.text(0.5, 0.5, "no apparent\ntemperature", ha="center", va="center", fontsize=9)
    return figure


def weights_panels(weights: Weights) -> list[Panel]:
    """Panels of the four weights (H, W) and those of patches."""
    patches = [
        Panel(image, f"weight of {name}", "share", colours="gray")
        for name, image in weights.patches.items()
    ]
    return [
        Panel(weights.background, "weight of the background", "share", (0.0, 1.0), "gray"),
        Panel(weights.wall, "weight of the walls", "share", colours="gray"),
        *patches,
        Panel(weights.vapour, "emitted by vapour", "photons s$^{-1}$ m$^{-2}$ sr$^{-1}$"),
        Panel(weights.liquid, "emitted by droplets", "photons s$^{-1}$ m$^{-2}$ sr$^{-1}$"),
    ]


def camera_pngs(
    images: Mapping[float, NDArray[np.floating | np.integer]], frame: Frame, *, title: str
) -> dict[float, bytes]:
    """PNGs of recorded `images` (H, W) with one scale, by the temperature of the background, K."""
    if not images:
        return {}
    bounds = [robust_limits(image.astype(np.float64)) for image in images.values()]
    low, high = min(low for low, _ in bounds), max(high for _, high in bounds)
    first = next(iter(images.values()))
    figure, [place] = sheet([""], aspect=aspect_of(frame, first.shape), heading=" ")
    norm = Normalize(low, high)
    drawn = draw(place, first.astype(np.float64), frame, norm=norm, colours="inferno")
    below = any(np.any(image < low) for image in images.values())
    above = any(np.any(image > high) for image in images.values())
    draw_key(place, drawn, "counts", below=below, above=above)
    pictures = {}
    for background_K, image in images.items():
        drawn.set_data(np.ma.masked_invalid(image.astype(np.float64)))
        figure.suptitle(plain(f"{title}, background {background_K:g} K"))
        pictures[background_K] = png_of(figure)
    return pictures


def errors_panels(maps: Maps) -> list[Panel]:
    """Panels of both standard errors (H, W); that of the temperature in logarithmic colours."""
    error_K = maps.apparent_temperature_standard_error_K
    positive = error_K[np.isfinite(error_K) & (error_K > 0)].astype(np.float64)
    known = maps.emissivity_standard_error
    limits = robust_limits(positive, cut=1.0) if positive.size else (0.0, 1.0)
    return [
        Panel(known, "standard error of emissivity", "", (0.0, robust_limits(known)[1]), "viridis"),
        Panel(
            error_K,
            "standard error of apparent temperature",
            "K",
            limits,
            "viridis",
            logarithmic=bool(positive.size),
        ),
    ]


def error_maps_panels(images: Mapping[str, NDArray[np.float32]]) -> list[Panel]:
    """Panels of the standard error of T_app, (H, W) by cause: the total, and the largest."""

    def mean(name: str) -> float:
        return float(np.nanmean(images[name]))

    largest = max((name for name in images if name != "total"), key=mean, default=None)
    shown = {name: images[name] for name in ("total", largest) if name is not None}
    titles = {name: f"source: {name}" for name in shown} | {"total": "all sources together"}
    limits = (0.0, robust_limits(images["total"])[1])
    return [Panel(shown[name], titles[name], "K", limits, "viridis") for name in shown]


@dataclass(frozen=True)
class Shares:
    """Shares (H, W) of the radiance of each pixel by origin, 0 to 1; NaN where nothing arrives.

    where: True where the spray adds or takes something; the means are over these pixels.
    """

    images: Mapping[str, NDArray[np.float64]]
    where: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        weights: Weights,
        reference: Weights,
        *,
        background: float,
        wall: float,
        patches: Mapping[str, float] | None = None,
    ) -> Shares:
        """Shares for given radiances [photons s-1 m-2 sr-1] of background, walls and patches.

        The spray is where the weights (H, W) differ from those without it by more than 1 %.
        """
        radiances = {"background": background, "wall": wall, **(patches or {})}
        total = compose(weights, background=background, wall=wall, patches=patches)
        outside = ("background", "wall", *weights.patches)
        images: dict[str, NDArray[np.float64]] = {}
        with np.errstate(divide="ignore", invalid="ignore"):
            for name in (*outside, "vapour", "liquid"):
                light = weights.images[name] * np.float64(radiances.get(name, 1.0))
                images[name] = np.where(total > 0, light / total, np.nan)
        before, now = (
            sum(part.images[name].astype(np.float64) for name in outside)
            for part in (reference, weights)
        )
        moved = np.abs(reference.background.astype(np.float64) - weights.background) > 0.01
        return cls(images, (np.abs(before - now) > 0.01) | moved)

    def means(self) -> dict[str, float]:
        """Mean shares over the pixels where the spray is; empty without any."""
        if not self.where.any():
            return {}
        names = {"wall": "walls", "liquid": "droplets"}
        return {
            names.get(name, name): float(np.nanmean(image[self.where]))
            for name, image in self.images.items()
        }

    def panels(self) -> list[Panel]:
        """Panels of the shares of vapour and droplets."""
        names = {"vapour": "vapour", "liquid": "droplets"}
        return [
            Panel(self.images[name], f"share of {text} in the signal", "share", (0.0, 1.0))
            for name, text in names.items()
        ]
