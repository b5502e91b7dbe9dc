"""Colours of a DIT map: hue is apparent temperature, saturation emissivity, value 1."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray

from cldit.dit.maps import Maps, Reason

COLD_HUE = 2.0 / 3.0  # blue; hot is 0, red
UNKNOWN = 0.83  # light grey of pixels without a value
_COUNTS_FROM = 0.1  # least emissivity of pixels that determine the default range


def temperature_range_K(maps: Maps) -> tuple[float, float]:
    """Percentiles 1 and 99 of the apparent temperatures, weighted by emissivity.

    Only pixels of emissivity above 0.1 count, or all if there are none. Rounded outwards to 5 K;
    (0, 0) without any temperature.
    """
    known = np.isfinite(maps.apparent_temperature_K)
    counted = known & (maps.emissivity > _COUNTS_FROM)
    chosen = counted if counted.any() else known
    if not chosen.any():
        return 0.0, 0.0
    temperature = maps.apparent_temperature_K[chosen].astype(np.float64)
    weight = np.maximum(maps.emissivity[chosen].astype(np.float64), 1e-12)
    order = np.argsort(temperature)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = (float(temperature[order][np.searchsorted(share, at)]) for at in (0.01, 0.99))
    low, high = 5.0 * math.floor(low / 5.0), 5.0 * math.ceil(high / 5.0)
    return (low, high) if high > low else (low, low + 5.0)


def emissivity_scale(maps: Maps) -> float:
    """Emissivity of full saturation: percentile 99.5, rounded up to 1, 2, 3, 5 times 10^n, <= 1."""
    known = maps.emissivity[np.isfinite(maps.emissivity)]
    most = float(np.percentile(known, 99.5)) if known.size else 1.0
    if not 1e-3 < most < 1.0:
        return 1.0 if most >= 1.0 else 1e-3
    power = 10.0 ** math.floor(math.log10(most))
    return next(step * power for step in (1, 2, 3, 5, 10) if step * power > most * (1 - 1e-6))


def map_colours(
    emissivity: NDArray[np.floating],
    temperature_K: NDArray[np.floating],
    *,
    range_K: tuple[float, float],
    scale: float,
) -> NDArray[np.float64]:
    """RGB (..., 3) of a DIT map; values beyond a scale get its end, NaN temperatures no hue.

    range_K: temperatures of blue and red. scale: emissivity of full saturation.
    """
    low, high = range_K
    span = high - low if high > low else 1.0
    warm = np.clip(np.nan_to_num((np.asarray(temperature_K, np.float64) - low) / span), 0.0, 1.0)
    saturation = np.clip(np.nan_to_num(np.asarray(emissivity, np.float64) / scale), 0.0, 1.0)
    saturation = np.where(np.isfinite(temperature_K), saturation, 0.0)
    colour = np.stack([COLD_HUE * (1.0 - warm), saturation, np.ones_like(warm)], axis=-1)
    return np.asarray(hsv_to_rgb(colour))


def pixel_colours(maps: Maps, *, range_K: tuple[float, float], scale: float) -> NDArray[np.float64]:
    """RGB (H, W, 3) of maps as `map_colours`; pixels without a value are light grey."""
    colour = map_colours(maps.emissivity, maps.apparent_temperature_K, range_K=range_K, scale=scale)
    known = (maps.reason == Reason.OK) | (maps.reason == Reason.EMISSIVITY_TOO_LOW)
    colour[~known] = UNKNOWN
    return colour
