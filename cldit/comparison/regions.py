"""Regions of a spray in its maps: root, plumes, tips and halo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.dit.maps import Maps
from cldit.optics.visible import VISIBLE_EMISSIVITY

_ROOT_M = (1e-3, 8e-3)  # below the tip, where the plumes overlap and are hardly heated
_CONTAINED = 0.97  # share of the visible spray within its reach
_TIPS = 0.85  # of the reach: beyond are the tips
_THIN = 0.3  # emissivity of the halo, at most


@dataclass(frozen=True, kw_only=True)
class Spray2D:
    """Emissivity (H, W) of a spray and the positions of its pixels from the injector's tip.

    x_m, z_m: (H, W), x to the right and z up. known: (H, W) pixels that count.
    """

    emissivity: Floats
    x_m: Floats
    z_m: Floats
    known: Mask

    @classmethod
    def of(
        cls, maps: Maps, *, pixel_m: tuple[float, float], centre_m: tuple[float, float]
    ) -> Spray2D:
        """The spray of maps with a pixel size and centre (x, z); pixels with a T_app count."""
        x_m, z_m = positions_m(maps.emissivity.shape, pixel_m=pixel_m, centre_m=centre_m)
        known = np.isfinite(maps.apparent_temperature_K)
        return cls(emissivity=maps.emissivity.astype(float), x_m=x_m, z_m=z_m, known=known)

    @property
    def visible(self) -> Mask:
        """Pixels that count with an emissivity above 0.05."""
        return np.asarray(self.known & (self.emissivity > VISIBLE_EMISSIVITY))

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
        far, weight = np.hypot(self.x_m, self.z_m)[seen], self.emissivity[seen]
        order = np.argsort(far)
        inside = np.cumsum(weight[order]) / weight.sum()
        return float(far[order][np.searchsorted(inside, _CONTAINED)])

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
