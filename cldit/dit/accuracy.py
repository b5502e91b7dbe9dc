"""How far the traced weights' own error reaches into the apparent temperature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.optics.planck import band_radiance, band_radiance_slope
from cldit.optics.response import Filter
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.optics.windows import Pane
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.radiance.weights import Weights, compose


def has_temperature(maps: Maps) -> NDArray[np.bool_]:
    """Which pixels (H, W) count: they have a T_app, and an emissivity above 0.05."""
    return np.isfinite(maps.apparent_temperature_K) & (maps.emissivity > VISIBLE_EMISSIVITY)


def temperature_errors_K(
    maps: Maps,
    error: Weights,
    *,
    surroundings: Surroundings,
    filter_um: Filter,
    pixels: NDArray[np.int64] | None = None,
) -> NDArray[np.float64]:
    """Error of T_app in every pixel, to first order; 0 in those that do not count.

    Args:
        maps: (H, W) of the same trace.
        error: of every weight, for instance half the difference of two independent traces.
        surroundings: before which they were evaluated.
        filter_um: edges of the filter.
        pixels: (N,) flat numbers of those of which `error` is; None: of all.

    Returns:
        (H W,) or (N,) errors.
    """
    chosen = np.arange(maps.emissivity.size) if pixels is None else pixels
    here = has_temperature(maps).reshape(-1)[chosen]
    counted = chosen[here]
    emissivity = maps.emissivity.reshape(-1)[counted].astype(float)
    temperature = maps.apparent_temperature_K.reshape(-1)[counted].astype(float)
    around = Boundary.of(
        surroundings,
        lambda temperature_K: band_radiance(temperature_K, filter_um=filter_um),
        lambda window: Pane(),  # cancels: it scales error and slope alike
    )
    apparent = band_radiance(temperature, filter_um=filter_um)
    some = error.map(lambda image: image.reshape(-1)[here])
    intercept = compose(some, background=0.0, wall=around.wall, patches=around.patches)
    # I_app = intercept / emissivity, and emissivity = 1 - w_bg on the disc.
    radiance = (intercept + some.background * apparent) / emissivity
    out = np.zeros(len(chosen))
    out[here] = radiance / band_radiance_slope(temperature, filter_um=filter_um)
    return out
