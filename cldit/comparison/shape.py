"""Size of a spray in its maps: penetration, angle and area, with the errors of the emissivity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cldit.comparison.regions import Spray2D
from cldit.comparison.shown import Shown
from cldit.optics.visible import VISIBLE_EMISSIVITY

_AT = (0.3, 0.7)  # share of the reach between which the angle is measured
_WITHIN = (0.025, 0.975)  # shares of the emissivity at both edges
_DENSE = 0.5  # emissivity

Value = tuple[float, float]


def angle_deg(spray: Spray2D) -> float:
    """Full angle that contains 95 % of the spray, by emissivity, at 30 to 70 % of its reach."""
    far, reach = np.hypot(spray.x_m, spray.z_m), spray.reach_m
    here = spray.visible & (far > _AT[0] * reach) & (far < _AT[1] * reach)
    if not here.any():
        return float("nan")
    angle = np.degrees(np.arctan2(spray.x_m[here], -spray.z_m[here]))
    order = np.argsort(angle)
    share = np.cumsum(spray.emissivity[here][order])
    low, high = np.interp(_WITHIN, share / share[-1], angle[order])
    return float(high - low)


def shape_of(shown: Shown) -> dict[str, Value]:
    """Penetration [mm], angle [degrees], visible and dense area [mm2], each with its error.

    The error is the change by one standard error of the emissivity in all pixels, and half a pixel
    of the penetration.
    """
    pixel_mm = tuple(1e3 * one for one in shown.pixel_m)
    spray = Spray2D.of(shown.maps, pixel_m=shown.pixel_m, centre_m=shown.centre_m)
    error = shown.maps.emissivity_standard_error if shown.noisy else 0.0 * spray.emissivity
    changed = [replace(spray, emissivity=spray.emissivity + sign * error) for sign in (1.0, -1.0)]

    def area(above: float) -> Callable[[Spray2D], float]:
        return lambda one: float(np.sum(one.emissivity > above) * pixel_mm[0] * pixel_mm[1])

    found: dict[str, Value] = {}
    for name, measure, least in (
        ("penetration_mm", lambda one: 1e3 * one.reach_m, max(pixel_mm) / 2.0),
        ("angle_deg", angle_deg, 0.0),
        ("visible_area_mm2", area(VISIBLE_EMISSIVITY), 0.0),
        ("dense_area_mm2", area(_DENSE), 0.0),
    ):
        more, less = (measure(one) for one in changed)
        found[name] = (measure(spray), float(np.hypot((more - less) / 2.0, least)))
    return found
