"""Colour maps by quantity, and the limits that figures of several maps can share.

All but the paper's hue rise or fall evenly in lightness, also for the colour-blind and in grey.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import ListedColormap, hsv_to_rgb
from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.errors import EvaluationError

TEMPERATURE = "plasma"
EMISSIVITY = "Blues"
ERROR = "viridis"
COUNTS = "inferno"
SHARE = "gray"
NEGATIVE = "gray_r"
MASS = "viridis_r"
CHANGE = "RdBu_r"
"""Of differences: white at zero."""

HUE = ListedColormap(
    # from blue, hue 2/3, to red, 0
    hsv_to_rgb([(2 / 3 * (1.0 - warm), 1.0, 1.0) for warm in np.linspace(0, 1, 256)]),
    name="hue",
)
"""Of apparent temperature in the paper (Section 3), whose lightness is not monotone."""

UNKNOWN = 0.83  # light grey of pixels without a value
_FADED = 0.1  # share of the full emissivity below which pixels fade


@dataclass(frozen=True)
class Scale:
    """Limits of the colours of maps: apparent temperature, K, and full emissivity."""

    range_K: tuple[float, float]
    emissivity: float

    @classmethod
    def of(cls, maps: Iterable[Maps]) -> "Scale":
        """Smallest scale that includes those of all maps; range (0, 0) without any temperature."""
        scales = [(temperature_range_K(result), emissivity_scale(result)) for result in maps]
        ranges = [(low, high) for (low, high), _ in scales if high > low]
        full = max((scale for _, scale in scales), default=1.0)
        if not ranges:
            return cls((0.0, 0.0), full)
        return cls((min(low for low, _ in ranges), max(high for _, high in ranges)), full)

    def ends_K(self, vmin: float | None, vmax: float | None) -> tuple[float, float]:
        """The given ends of the range, or its own; raises EvaluationError if they do not rise."""
        low, high = self.range_K
        ends = (low if vmin is None else vmin, high if vmax is None else vmax)
        if (vmin, vmax) != (None, None) and not ends[0] < ends[1]:
            raise EvaluationError(
                f"vmin {ends[0]:g} K, vmax {ends[1]:g} K; allowed: vmin below vmax"
            )
        return ends

    def opacity(self, emissivity: NDArray[np.floating], *, paper: bool) -> NDArray[np.float64]:
        """Opacity (H, W) of pixels over white: 1 from a tenth of the full emissivity.

        As in the paper, opacity is the emissivity over the full one: of a pure hue that is the
        saturation at value 1.
        """
        full = self.emissivity if paper else _FADED * self.emissivity
        return np.clip(np.nan_to_num(np.asarray(emissivity, np.float64) / full), 0.0, 1.0)


def temperature_range_K(maps: Maps) -> tuple[float, float]:
    """Percentiles 2 and 99.5 of the apparent temperatures, weighted by emissivity: a small cold
    nozzle does not take half of the colours.

    Only pixels that do not fade count, or all if there are none. Rounded outwards to 5 K; (0, 0)
    without any temperature.
    """
    finite = np.isfinite(maps.apparent_temperature_K)
    counted = finite & (maps.emissivity > _FADED * emissivity_scale(maps))
    chosen = counted if counted.any() else finite
    if not chosen.any():
        return 0.0, 0.0
    temperature = maps.apparent_temperature_K[chosen].astype(np.float64)
    weight = np.maximum(maps.emissivity[chosen].astype(np.float64), 1e-12)
    order = np.argsort(temperature)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = (float(temperature[order][np.searchsorted(share, at)]) for at in (0.02, 0.995))
    low, high = 5.0 * math.floor(low / 5.0), 5.0 * math.ceil(high / 5.0)
    return (low, high) if high > low else (low, low + 5.0)


def emissivity_scale(maps: Maps) -> float:
    """Full emissivity: percentile 99.5, rounded up to 1, 2, 3, 5 times 10^n, <= 1."""
    emissivity = maps.emissivity[np.isfinite(maps.emissivity)]
    upper = float(np.percentile(emissivity, 99.5)) if emissivity.size else 1.0
    if not 1e-3 < upper < 1.0:
        return 1.0 if upper >= 1.0 else 1e-3
    power = 10.0 ** math.floor(math.log10(upper))
    return next(step * power for step in (1, 2, 3, 5, 10) if step * power > upper * (1 - 1e-6))


def robust_limits(values: NDArray[np.floating], *, cut: float = 0.1) -> tuple[float, float]:
    """Percentiles `cut` and 100 - `cut` of the finite `values`; never an empty interval."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = (float(at) for at in np.percentile(finite, [cut, 100.0 - cut]))
    return (low, high) if high > low else (low, low + max(1.0, abs(low)) * 1e-6)
