"""Liquid penetration by projected volume, as defined by the Engine Combustion Network.

The threshold is a volume of liquid per projected area, in the mean of many injections. A parcel is
one sample of those: eddies could have moved its droplets anywhere around it. So each parcel is
projected as a Gaussian spot, half as wide as a free jet at its distance from the injector; then one
injection shows the same as the mean of many, for any number of parcels and any grid of the gas.
"""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats
from cldit.spray.flow.gas import HALF_WIDTH
from cldit.spray.numba_typing import compiled

PROJECTED_m = 2.0e-6  # 2.0e-3 mm3/mm2
THIN_PROJECTED_m = 0.2e-6
PIXEL_m = 0.5e-3
SPOT = 0.5 * HALF_WIDTH  # standard deviation, over the distance from the injector
_CUT = 3.0  # standard deviations


def projected_reach_m(position_m: Floats, volume_m3: Floats) -> tuple[float, float]:
    """Penetration of the liquid along the injector's axis (-z), for both thresholds.

    It is the largest distance at which the liquid volume (N,) of the parcels at positions (N, 3),
    per area across a line of sight, reaches `PROJECTED_m` and `THIN_PROJECTED_m`; 0 if it does not.
    The result is the mean of the lines of sight along x and y.
    """
    seen = (volume_m3 > 0) & (position_m[:, 2] < 0)
    position, volume = position_m[seen], volume_m3[seen]
    if not len(volume):
        return 0.0, 0.0
    spot = np.maximum(SPOT * np.linalg.norm(position, axis=1), 0.5 * PIXEL_m)
    deep = -position[:, 2]
    rows = int((deep + _CUT * spot).max() / PIXEL_m) + 2
    tops = []
    for axis in (0, 1):
        aside = position[:, axis] - (position[:, axis] - _CUT * spot).min() + PIXEL_m
        across = int((aside + _CUT * spot).max() / PIXEL_m) + 2
        image = np.zeros((across, rows))
        _paint(*_binned(aside / PIXEL_m, deep / PIXEL_m, spot / PIXEL_m, volume), image)
        tops.append(image.max(axis=0))
    far, thin = (
        float(np.mean([_farthest(top, edge) for top in tops]))
        for edge in (PROJECTED_m, THIN_PROJECTED_m)
    )
    return far, thin


def _binned(
    aside: Floats, deep: Floats, spot: Floats, volume: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """One spot for each pixel with parcels: mean place and width, and volume per area."""
    pixel = aside.astype(np.int64) * (int(deep.max()) + 1) + deep.astype(np.int64)
    at = np.unique(pixel, return_inverse=True)[1].reshape(-1)
    whole = np.bincount(at, volume)
    x, y, wide = (np.bincount(at, volume * each) / whole for each in (aside, deep, spot))
    return x, y, wide, whole / PIXEL_m**2


def _farthest(top: Floats, edge: float) -> float:
    """Last distance at which the largest values of rows (R,) reach `edge`, linear between rows."""
    rows = np.flatnonzero(top > edge)
    if not rows.size:
        return 0.0
    row = int(rows[-1])
    here, below = float(top[row]), float(top[row + 1]) if row + 1 < len(top) else 0.0
    return PIXEL_m * (row + 0.5 + (here - edge) / (here - below))


@compiled
def _spot(at: float, width: float, weights: Floats) -> tuple[int, int]:
    """First and last pixel of a spot; writes the weights of its pixels, of sum 1."""
    first = max(int(np.floor(at - _CUT * width)), 0)
    last = min(int(np.floor(at + _CUT * width)), weights.shape[0] - 1)
    total = 0.0
    for i in range(first, last + 1):
        weights[i] = np.exp(-0.5 * ((i + 0.5 - at) / width) ** 2)
        total += weights[i]
    for i in range(first, last + 1):
        weights[i] /= total
    return first, last


@compiled
def _paint(across: Floats, down: Floats, width: Floats, amount: Floats, image: Floats) -> None:
    """Adds spots (N,) to an image (A, R); lengths in pixels."""
    aside, deep = np.empty(image.shape[0]), np.empty(image.shape[1])
    for n in range(across.shape[0]):
        first, last = _spot(across[n], width[n], aside)
        top, bottom = _spot(down[n], width[n], deep)
        for i in range(first, last + 1):
            part = amount[n] * aside[i]
            for k in range(top, bottom + 1):
                image[i, k] += part * deep[k]
