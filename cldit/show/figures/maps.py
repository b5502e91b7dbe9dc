"""Figures of maps, weights, shares, camera images and errors, with axes in mm."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cldit.camera.view import SensorView
from cldit.dit.maps import Maps, Reason
from cldit.radiance.weights import Weights, compose
from cldit.run.ensemble_statistics import Ensemble
from cldit.scene import Scene
from cldit.show.figures.colours import (
    CHANGE,
    COUNTS,
    EMISSIVITY,
    ERROR,
    HUE,
    SHARE,
    TEMPERATURE,
    Scale,
    robust_limits,
)
from cldit.show.figures.panels import GREY, ImageFrame, Panel, Window, panels_figure, window_around

Colours = str | Colormap
"""A colour map of matplotlib, or its name."""


def frame_of(scene: Scene, *, sensor: bool = False) -> ImageFrame:
    """Axes of the traced images of a scene, or of those of its sensor."""
    (width, height), (columns, rows) = scene.camera.field_m, scene.camera.pixels
    pixel_m = SensorView.from_scene(scene).pixel_m if sensor else (width / columns, height / rows)
    x, _, z = scene.target_m
    return ImageFrame(pixel_m, (x, z))


def spray_window(maps: Maps, frame: ImageFrame) -> Window:
    """Part of the maps (H, W) with the spray, see `window_around`."""
    return window_around(np.where(maps.reason == Reason.OK, maps.emissivity, 0.0), frame)


def spray_figure(
    panels: Sequence[Panel],
    maps: Maps,
    frame: ImageFrame,
    *,
    title: str,
    legend: Sequence[tuple[Any, str]] = (),
) -> Figure:
    """Figure of panels, cropped to the spray of the maps (H, W)."""
    window = spray_window(maps, frame)
    return panels_figure(panels, frame, title=title, window=window, legend=legend)


def map_panel(
    maps: Maps, scale: Scale, *, title: str, paper: bool, cmap: Colours | None = None, **keys: Any
) -> Panel:
    """Panel of T_app (H, W), paler where the emissivity is low, or in the paper's colours."""
    low, high = scale.range_K
    return Panel(
        maps.apparent_temperature_K,
        title,
        "apparent temperature / K",
        (low, high) if high > low else None,
        cmap or (HUE if paper else TEMPERATURE),
        opacity=scale.opacity(maps.emissivity, paper=paper),
        clear=maps.reason == Reason.EMISSIVITY_TOO_LOW,
        **keys,
    )


def map_panels(maps: Maps, scale: Scale, *, paper: bool = False, **options: Any) -> list[Panel]:
    """Panels of T_app and emissivity (H, W)."""
    limits = (0.0, scale.emissivity)
    return [
        map_panel(maps, scale, title="apparent temperature", paper=paper, **options),
        Panel(maps.emissivity, "emissivity", "emissivity", limits, EMISSIVITY),
    ]


def reasons_in(maps: Maps, frame: ImageFrame, window: Window) -> set[int]:
    """Reasons that occur in a part of maps."""
    return set(np.unique(maps.reason[frame.slices(maps.reason.shape, window)]).tolist())


def map_legend(
    reasons: Iterable[int], scale: Scale, *, paper: bool, cmap: Colours | None = None
) -> list[tuple[Any, str]]:
    """Colours that no colour bar shows, of pixels of these `reasons`, and their meaning."""
    present = set(reasons)
    legend: list[tuple[Any, str]] = []
    if Reason.OK in present:
        full = scale.emissivity if paper else 0.1 * scale.emissivity
        colours = cmap or ("hsv" if paper else TEMPERATURE)
        shade = (colormaps[colours] if isinstance(colours, str) else colours)(0.4, alpha=0.4)
        legend.append((shade, f"paler: emissivity below {full:g}"))
    if Reason.EMISSIVITY_TOO_LOW in present:
        legend.append(("white", "transparent: no apparent temperature"))
    if causes := ", ".join(cause for reason, cause in _SHORT.items() if reason in present):
        legend.append((GREY, f"no value: {causes}"))
    return legend


_SHORT = {
    Reason.TOO_FEW_BACKGROUNDS: "fewer than two backgrounds",
    Reason.SATURATED: "saturated",
    Reason.BAD_PIXEL: "defective pixel",
    Reason.BACKGROUND_NOT_VISIBLE: "background not visible",
    Reason.NEGATIVE_RADIANCE: "no emission above zero within noise",
}


def map_figure(
    maps: Maps,
    frame: ImageFrame,
    *,
    title: str,
    vmin: float | None = None,
    vmax: float | None = None,
    cmap: Colours | None = None,
    scale: float | None = None,
    window: Window | None = None,
    paper: bool = False,
    stamp: str = "",
    reasons: Iterable[int] | None = None,
) -> Figure:
    """Figure of both maps (H, W), cropped to the spray.

    Args:
        vmin, vmax: T_app of the colours' ends, K; None: percentiles, see `temperature_range_K`.
        cmap: colours of T_app, of matplotlib; None: cldit's, or the paper's.
        scale: emissivity of the full colour; None: see `emissivity_scale`.
        window: left, right, bottom and top of the part to show, mm; None: the spray.
        paper: colours of the paper (Section 3): hue is T_app, saturation emissivity.
        stamp: text in the first panel, such as its time.
        reasons: of pixels in the legend; None: of those that are shown.
    """
    default = Scale.of([maps])
    limits = Scale(default.ends_K(vmin, vmax), scale or default.emissivity)
    window = window or spray_window(maps, frame)
    panels = map_panels(maps, limits, paper=paper, cmap=cmap, stamp=stamp)
    legend = map_legend(reasons or reasons_in(maps, frame, window), limits, paper=paper, cmap=cmap)
    return panels_figure(panels, frame, title=title, window=window, legend=legend)


def weights_panels(weights: Weights) -> list[Panel]:
    """Panels of the four weights (H, W) and those of patches."""
    patches = [
        Panel(image, f"weight of {name}", "share", colours=SHARE)
        for name, image in weights.patches.items()
    ]
    return [
        Panel(weights.background, "weight of the background", "share", (0.0, 1.0), SHARE),
        Panel(weights.wall, "weight of the walls", "share", colours=SHARE),
        *patches,
        Panel(weights.vapour, "emitted by vapour", "photons / (s m² sr)"),
        Panel(weights.liquid, "emitted by droplets", "photons / (s m² sr)"),
    ]


def camera_figures(
    images: Mapping[float, NDArray[np.floating | np.integer]], frame: ImageFrame, *, title: str
) -> dict[float, Figure]:
    """Figures of recorded `images` (H, W) in one scale, by temperature of the background, K."""
    bounds = [robust_limits(image.astype(np.float64)) for image in images.values()]
    limits = (
        min((low for low, _ in bounds), default=0.0),
        max((high for _, high in bounds), default=1.0),
    )
    return {
        at: panels_figure(
            [Panel(image, "", "signal / counts", limits, COUNTS)],
            frame,
            title=f"{title}, background {at:g} K",
        )
        for at, image in images.items()
    }


def error_panel(
    image: NDArray[np.floating],
    title: str,
    label: str,
    *,
    limits: tuple[float, float] | None = None,
    decades: bool = False,
    clear: NDArray[np.bool_] | None = None,
) -> Panel:
    """Panel of an error (H, W): colours from 0, or logarithmic for errors over `decades`."""
    positive = image[np.isfinite(image) & (image > 0)].astype(np.float64)
    decades = decades and bool(positive.size)
    if limits is None:
        limits = robust_limits(positive, cut=1.0) if decades else (0.0, robust_limits(image)[1])
    return Panel(image, title, label, limits, ERROR, logarithmic=decades, clear=clear)


def change_panel(
    image: NDArray[np.floating], title: str, label: str, *, largest: float | None = None
) -> Panel:
    """Panel of changes (H, W): white at zero, but for changes of one sign without `largest`."""
    low, high = robust_limits(image)
    if largest is None and not low < 0.0 < high:
        return Panel(image, title, label, (low, high), ERROR)
    largest = max(-low, high) if largest is None else largest
    return Panel(image, title, label, (-largest, largest), CHANGE)


def errors_panels(maps: Maps) -> list[Panel]:
    """Panels of both standard errors (H, W); that of the temperature in logarithmic colours."""
    return [
        error_panel(
            maps.apparent_temperature_standard_error_K,
            "standard error of T_app",
            "standard error / K",
            decades=True,
            clear=maps.reason == Reason.EMISSIVITY_TOO_LOW,
        ),
        error_panel(
            maps.emissivity_standard_error, "standard error of emissivity", "standard error"
        ),
    ]


def injections_panels(ensemble: Ensemble) -> list[Panel]:
    """Panels of how injections differ: the deviation of one, and the mean's standard error."""
    deviation = ensemble["apparent_temperature_deviation_K"]
    error = ensemble["apparent_temperature_standard_error_K"]
    limits = (0.0, robust_limits(deviation)[1])
    titles = ("standard deviation of one injection", "standard error of the mean light")
    return [
        error_panel(image, title, "T_app / K", limits=limits)
        for image, title in zip((deviation, error), titles, strict=True)
    ]


def error_maps_panels(
    images: Mapping[str, NDArray[np.float32]], *, unit: str = " / K"
) -> list[Panel]:
    """Panels of the standard error of a result, (H, W) by cause: the total, and the largest."""

    def mean(name: str) -> float:
        return float(np.nanmean(images[name]))

    largest = max((name for name in images if name != "total"), key=mean, default=None)
    titles = {"total": "all sources together"}
    if largest is not None:
        titles[largest] = f"source: {largest}"
    limits = (0.0, robust_limits(images["total"])[1])
    return [
        error_panel(images[name], title, f"standard error{unit}", limits=limits)
        for name, title in titles.items()
    ]


def shares_of_light(
    weights: Weights,
    reference: Weights,
    *,
    background: float,
    wall: float,
    patches: Mapping[str, float],
) -> tuple[list[Panel], dict[str, float]]:
    """Shares of the radiance by origin: panels of vapour and droplets, and means of all origins.

    background, wall, patches: radiances [photons s-1 m-2 sr-1]. A panel is omitted if its light is
    visible nowhere. The means are over the pixels where the spray is: the weights (H, W) differ
    from those without it by more than 1 %; empty if there are none.
    """
    radiances = {"background": background, "wall": wall, **patches}
    total = compose(weights, background=background, wall=wall, patches=patches)
    outside = ("background", "wall", *weights.patches)
    images: dict[str, NDArray[np.float64]] = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        for name in (*outside, "vapour", "liquid"):
            light = weights.images[name] * np.float64(radiances.get(name, 1.0))
            images[name] = np.where(total > 0, light / total, np.nan)
    outside_bare, outside_spray = (
        sum(part.images[name].astype(np.float64) for name in outside)
        for part in (reference, weights)
    )
    moved = np.abs(reference.background.astype(np.float64) - weights.background) > 0.01
    spray = (np.abs(outside_bare - outside_spray) > 0.01) | moved
    origins = {"wall": "walls", "liquid": "droplets"}
    means = {
        origins.get(name, name): float(np.nanmean(image[spray]))
        for name, image in images.items()
        if spray.any()
    }
    panels = [
        Panel(images[name], f"share of {origin} in the signal", "share", (0.0, 1.0))
        for name, origin in (("vapour", "vapour"), ("liquid", "droplets"))
        if np.nanmax(images[name], initial=0.0) > 0.05  # else the panel is black
    ]
    return panels, means
