"""How far the traced weights' own error reaches into the apparent temperature."""

from __future__ import annotations

import numpy as np

from cldit.dit.maps import Maps
from cldit.optics.planck import band_radiance, band_radiance_slope
from cldit.optics.response import Filter
from cldit.optics.windows import Pane
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.radiance.weights import Weights, compose

VISIBLE_EMISSIVITY = 0.05  # below it a temperature says little, whatever the trace


def temperature_error_K(
    maps: Maps, error: Weights, *, surroundings: Surroundings, filter_um: Filter
) -> float:
    """RMS error of T_app over the pixels of emissivity above 0.05, to first order; NaN if none.

    Args:
        maps: (H, W) of the same trace.
        error: error of every weight, for instance half the difference of two independent traces.
        surroundings: before which they were evaluated.
        filter_um: edges of the filter.
    """
    emissivity = maps.emissivity.astype(float)
    temperature = maps.apparent_temperature_K.astype(float)
    here = np.isfinite(temperature) & (emissivity > VISIBLE_EMISSIVITY)
    if not here.any():
        return float("nan")
    around = Boundary.of(
        surroundings,
        lambda temperature_K: band_radiance(temperature_K, filter_um=filter_um),
        lambda window: Pane(),  # cancels: it scales error and slope alike
    )
    apparent = band_radiance(temperature[here], filter_um=filter_um)
    intercept = compose(error, background=0.0, wall=around.wall, patches=around.patches)
    # I_app = intercept / emissivity, and emissivity = 1 - w_bg on the disc.
    radiance = (intercept[here] + error.background[here] * apparent) / emissivity[here]
    error_K = radiance / band_radiance_slope(temperature[here], filter_um=filter_um)
    return float(np.sqrt(np.mean(error_K**2)))
