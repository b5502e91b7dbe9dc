"""One quantity of a result, drawn into axes of the user's own figure."""

import numpy as np
from matplotlib.axes import Axes

from cldit.dit.maps import Maps
from cldit.dit.profile import Profile
from cldit.show.figures.colours import EMISSIVITY, TEMPERATURE, Scale
from cldit.show.figures.maps import Colours, spray_window
from cldit.show.figures.panels import ImageFrame, Window, beyond


def draw_map(
    ax: Axes,
    maps: Maps,
    frame: ImageFrame,
    *,
    emissivity: bool = False,
    vmin: float | None = None,
    vmax: float | None = None,
    cmap: Colours | None = None,
    window: Window | None = None,
) -> None:
    """T_app, or emissivity, of maps (H, W) with its colour bar; pixels without one stay clear.

    vmin, vmax: values of the colours' ends; None: percentiles. cmap: colours. window: left, right,
    bottom and top, mm; None: the spray.
    """
    image = maps.emissivity if emissivity else maps.apparent_temperature_K
    scale = Scale.of([maps])
    if emissivity:
        low, high = vmin or 0.0, scale.emissivity if vmax is None else vmax
    else:
        low, high = scale.ends_K(vmin, vmax)
    left, right, bottom, top = window or spray_window(maps, frame)
    drawn = ax.imshow(
        image,
        cmap=cmap or (EMISSIVITY if emissivity else TEMPERATURE),
        extent=frame.extent_mm(image.shape),
        vmin=low,
        vmax=high,
        interpolation="nearest",
    )
    ax.set(xlim=(left, right), ylim=(bottom, top))
    ax.set(xlabel=f"{frame.axes[0]} / mm", ylabel=f"{frame.axes[1]} / mm")
    shown = image[frame.slices(image.shape, (left, right, bottom, top))]
    label = "emissivity" if emissivity else "apparent temperature / K"
    ax.figure.colorbar(drawn, ax=ax, label=label, extend=beyond((low, high), shown))


def draw_profile(
    ax: Axes, profile: Profile, *, emissivity: bool = False, color: str | None = None
) -> None:
    """T_app, or emissivity, along a line, with a band of one standard error.

    The band of an emissivity ends at 0 and 1, or at the value if that is beyond.
    """
    name = "emissivity" if emissivity else "apparent_temperature"
    value = profile.emissivity if emissivity else profile.apparent_temperature_K
    error = getattr(profile, f"{name}_standard_error{'' if emissivity else '_K'}")
    low, high = value - error, value + error
    if emissivity:
        low = np.maximum(low, np.minimum(value, 0.0))
        high = np.minimum(high, np.maximum(value, 1.0))
    along = 1e3 * profile.distance_m
    (line,) = ax.plot(along, value, color=color)
    ax.fill_between(along, low, high, color=line.get_color(), alpha=0.25, lw=0)
    ax.set_xlabel("distance from the start / mm")
    ax.set_ylabel("emissivity" if emissivity else "apparent temperature / K")
