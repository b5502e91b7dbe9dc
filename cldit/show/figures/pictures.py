"""Pictures as PNG: maps, weights, camera images, errors; axes in mm, injector tip at (0, 0)."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cldit.dit.maps import Maps, Reason
from cldit.radiance.weights import Weights
from cldit.show.figures.colours import (
    emissivity_scale,
    map_colours,
    picture_colours,
    temperature_range_K,
)
from cldit.show.figures.panels import (
    Frame,
    Panel,
    aspect_of,
    axes_mm,
    draw,
    draw_key,
    panels_picture,
    robust_limits,
)
from cldit.show.figures.sheet import figure_of, plain, png_of, sheet


def _explained(maps: Maps) -> str:
    """What white and grey mean here, with the number of pixels; empty when nothing is."""
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


def map_picture(
    maps: Maps,
    frame: Frame,
    *,
    title: str,
    range_K: tuple[float, float] | None = None,
    scale: float | None = None,
    note: str | None = None,
    stamp: str = "",
) -> bytes:
    """PNG of `map_figure`.

    Args:
        maps, frame, title, range_K, scale, note, stamp: as for `map_figure`; maps (H, W).
    """
    figure = map_figure(
        maps, frame, title=title, range_K=range_K, scale=scale, note=note, stamp=stamp
    )
    return png_of(figure)


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
    """Both maps in one: hue = apparent temperature, saturation = emissivity, value = 1.

    The colouring of the paper (Section 3). Where there is no temperature since the spray is
    transparent, white; where there is none for another reason, light grey.

    Args:
        maps: (H, W).
        frame: axes.
        title: above the picture.
        range_K: temperatures of blue and red; None: percentiles, see `temperature_range_K`.
        scale: emissivity of full saturation; None: see `emissivity_scale`.
        note: small print; None: what white and grey mean in these maps, in one line or more.
        stamp: in the upper left corner of the picture, such as its time.
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
    axes, key = place.picture, place.key
    axes.imshow(
        picture_colours(maps, range_K=chosen_K, scale=full),
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


def weights_picture(weights: Weights, frame: Frame, *, title: str) -> bytes:
    """PNG of the four weights and those of patches.

    Args:
        weights: (H, W).
        frame: axes.
        title: above all.
    """
    return panels_picture(weights_panels(weights), frame, title=title)


def weights_panels(weights: Weights) -> list[Panel]:
    """The four weights (H, W) and those of patches, a panel each."""
    patches = [
        Panel(image, f"seen of {name}", "share", colours="gray")
        for name, image in weights.patches.items()
    ]
    return [
        Panel(weights.background, "seen of the background", "share", (0.0, 1.0), "gray"),
        Panel(weights.wall, "seen of the walls", "share", colours="gray"),
        *patches,
        Panel(weights.vapour, "emitted by vapour", "photons s$^{-1}$ m$^{-2}$ sr$^{-1}$"),
        Panel(weights.liquid, "emitted by droplets", "photons s$^{-1}$ m$^{-2}$ sr$^{-1}$"),
    ]


def camera_pictures(
    images: Mapping[float, NDArray[np.floating | np.integer]], frame: Frame, *, title: str
) -> dict[float, bytes]:
    """Draws recorded images with one scale, so that they can be compared.

    Args:
        images: (rows, columns) counts by their background's temperature [K].
        frame: axes.
        title: above each.

    Returns:
        PNGs by temperature.
    """
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


def errors_picture(maps: Maps, frame: Frame, *, title: str) -> bytes:
    """PNG of both standard errors; that of the temperature spans decades, in log colours.

    Args:
        maps: (H, W).
        frame: axes.
        title: above all.
    """
    return panels_picture(errors_panels(maps), frame, title=title)


def errors_panels(maps: Maps) -> list[Panel]:
    """Both standard errors (H, W), a panel each."""
    error_K = maps.apparent_temperature_standard_error_K
    positive = error_K[np.isfinite(error_K) & (error_K > 0)].astype(np.float64)
    known = maps.emissivity_standard_error
    limits = robust_limits(positive, cut=1.0) if positive.size else (0.0, 1.0)
    return [
        Panel(
            known,
            "standard error of emissivity",
            "",
            (0.0, robust_limits(known)[1]),
            "viridis",
        ),
        Panel(
            error_K,
            "standard error of apparent temperature",
            "K",
            limits,
            "viridis",
            logarithmic=bool(positive.size),
        ),
    ]


def error_maps_picture(
    images: Mapping[str, NDArray[np.float32]], frame: Frame, *, title: str
) -> bytes:
    """PNG of the standard error of T_app in every pixel: all causes together, and the largest.

    Args:
        images: (H, W) by cause, K, NaN where there is no T_app; `total` is among them.
        frame: axes.
        title: above all.
    """
    return panels_picture(error_maps_panels(images), frame, title=title)


def error_maps_panels(images: Mapping[str, NDArray[np.float32]]) -> list[Panel]:
    """The standard error of T_app, `images` (H, W) by cause: all together, and the largest."""

    def mean(name: str) -> float:
        return float(np.nanmean(images[name]))

    largest = max((name for name in images if name != "total"), key=mean, default=None)
    shown = ["total", *([] if largest is None else [largest])]
    limits = (0.0, robust_limits(images["total"])[1])
    return [
        Panel(
            images[name],
            "all causes together" if name == "total" else f"of it by {name}",
            "K",
            limits,
            "viridis",
        )
        for name in shown
    ]


def nodes_picture(errors_K: Sequence[float], *, chosen: int, title: str) -> bytes:
    """PNG of the error in T_app with 1, 2, .. spectral nodes.

    Args:
        errors_K: of each number.
        chosen: the number that is marked.
        title: above the picture.
    """
    figure = figure_of(5.0, 3.4)
    axes = figure.subplots()
    numbers = np.arange(1, len(errors_K) + 1)
    shown = np.maximum(np.asarray(errors_K, float), 1e-4)  # 0 has no place on a log axis
    axes.semilogy(numbers, shown, "o-", color="C0")
    axes.plot(chosen, shown[chosen - 1], "o", color="C3", markersize=9, label="traced")
    axes.set_xlabel("number of wavelengths")
    axes.set_ylabel("RMS error of apparent temperature / K")
    axes.set_title(plain(title), fontsize="medium")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    return png_of(figure)
