"""Regions of a spray in its maps: root, plumes, tips and halo; its penetration, angle and area."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.comparison.shown import Shown
from cldit.dit.maps import Maps
from cldit.optics.visible import VISIBLE_EMISSIVITY

_ROOT_M = (1e-3, 8e-3)  # below the tip, where the plumes overlap and are hardly heated
_CONTAINED = 0.97  # share of the visible spray within its reach
_TIPS = 0.85  # of the reach: beyond are the tips
_THIN = 0.3  # emissivity of the halo, at most
_AT = (0.3, 0.7)  # share of the reach between which the angle is measured
_WITHIN = (0.025, 0.975)  # shares of the emissivity at both edges
_DENSE = 0.5  # emissivity

Value = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Spray2D:
    """Emissivity (H, W) of a spray and the positions of its pixels from the injector's tip.

    x_m, z_m: (H, W), x to the right and z up. counted: (H, W) pixels that
    count.
    """

    emissivity: Floats
    x_m: Floats
    z_m: Floats
    counted: Mask

    @classmethod
    def of(
        cls, maps: Maps, *, pixel_m: tuple[float, float], centre_m: tuple[float, float]
    ) -> Spray2D:
        """The spray of maps with a pixel size and centre (x, z); pixels with a T_app count."""
        x_m, z_m = positions_m(maps.emissivity.shape, pixel_m=pixel_m, centre_m=centre_m)
        finite = np.isfinite(maps.apparent_temperature_K)
        return cls(emissivity=maps.emissivity.astype(float), x_m=x_m, z_m=z_m, counted=finite)

    @property
    def visible(self) -> Mask:
        """Pixels that count with an emissivity above 0.05."""
        return np.asarray(self.counted & (self.emissivity > VISIBLE_EMISSIVITY))

    @property
    def root(self) -> Mask:
        """Visible spray 1 to 8 mm below the injector tip."""
        return np.asarray(self.visible & (self.z_m < -_ROOT_M[0]) & (self.z_m > -_ROOT_M[1]))

    @property
    def reach_m(self) -> float:
        """Distance from the injector that contains 97 % of the visible spray, by emissivity."""
        seen = self.visible
        if not seen.any():
            return float("nan")
        distance_m, weight = np.hypot(self.x_m, self.z_m)[seen], self.emissivity[seen]
        order = np.argsort(distance_m)
        inside = np.cumsum(weight[order]) / weight.sum()
        return float(distance_m[order][np.searchsorted(inside, _CONTAINED)])

    def tips(self, share: float = _TIPS) -> Mask:
        """Visible spray beyond `share` of its reach, which single droplets do not determine."""
        return np.asarray(self.visible & (np.hypot(self.x_m, self.z_m) > share * self.reach_m))

    @property
    def regions(self) -> dict[str, Mask]:
        """All visible pixels, and the parts that they are divided into.

        Root and tips are as above; of the rest, halo is thin (emissivity up to 0.3) and plumes
        are dense.
        """
        root = self.root
        tips = self.tips() & ~root
        rest = self.visible & ~root & ~tips
        thin = self.emissivity <= _THIN
        return {
            "all": self.visible,
            "root": root,
            "plumes": rest & ~thin,
            "tips": tips,
            "halo": rest & thin,
        }


def positions_m(
    shape: tuple[int, ...], *, pixel_m: tuple[float, float], centre_m: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Coordinates x and z (H, W) of the pixels of an image; row 0 is at the top."""
    rows, columns = shape
    across = centre_m[0] + (np.arange(columns) - (columns - 1) / 2) * pixel_m[0]
    up = centre_m[1] - (np.arange(rows) - (rows - 1) / 2) * pixel_m[1]
    x_m, z_m = np.meshgrid(across, up)
    return x_m, z_m


def angle_deg(spray: Spray2D) -> float:
    """Full angle that contains 95 % of the spray, by emissivity, at 30 to 70 % of its reach."""
    distance_m, reach = np.hypot(spray.x_m, spray.z_m), spray.reach_m
    annulus = spray.visible & (distance_m > _AT[0] * reach) & (distance_m < _AT[1] * reach)
    if not annulus.any():
        return float("nan")
    angle = np.degrees(np.arctan2(spray.x_m[annulus], -spray.z_m[annulus]))
    order = np.argsort(angle)
    share = np.cumsum(spray.emissivity[annulus][order])
    low, high = np.interp(_WITHIN, share / share[-1], angle[order])
    return float(high - low)


def shape_of(shown: Shown) -> dict[str, Value]:
    """Penetration [mm], angle [degrees], visible and dense area [mm2], each with its error.

    The error is the change by one standard error of the emissivity in all pixels, and half a pixel
    of the penetration.
    """
    pixel_mm = tuple(1e3 * edge_m for edge_m in shown.pixel_m)
    spray = Spray2D.of(shown.maps, pixel_m=shown.pixel_m, centre_m=shown.centre_m)
    error = shown.maps.emissivity_standard_error if shown.noisy else 0.0 * spray.emissivity
    changed = [replace(spray, emissivity=spray.emissivity + sign * error) for sign in (1.0, -1.0)]

    def area(above: float) -> Callable[[Spray2D], float]:
        return lambda seen: float(np.sum(seen.emissivity > above) * pixel_mm[0] * pixel_mm[1])

    shape: dict[str, Value] = {}
    for name, measure, resolution in (
        ("penetration_mm", lambda seen: 1e3 * seen.reach_m, max(pixel_mm) / 2.0),
        ("angle_deg", angle_deg, 0.0),
        ("visible_area_mm2", area(VISIBLE_EMISSIVITY), 0.0),
        ("dense_area_mm2", area(_DENSE), 0.0),
    ):
        larger, smaller = (measure(seen) for seen in changed)
        shape[name] = (measure(spray), float(np.hypot((larger - smaller) / 2.0, resolution)))
    return shape
