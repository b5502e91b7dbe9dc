"""Liquid penetration by projected volume, as defined by the Engine Combustion Network.

The threshold is a volume of liquid per projected area, in the mean of many injections. A parcel is
one sample of those: eddies could have moved its droplets anywhere around it. So each parcel is
projected as a Gaussian spot, half as wide as a free jet at its distance from the injector; then one
injection shows the same as the mean of many, for any number of parcels and any grid of the gas.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from cldit.arrays import Floats
from cldit.spray.flow.gas import HALF_WIDTH

PROJECTED_m = 2.0e-6  # 2.0e-3 mm3/mm2
THIN_PROJECTED_m = 0.2e-6
PIXEL_m = 0.5e-3
SPOT = 0.5 * HALF_WIDTH  # standard deviation, over the distance from the injector
_CUT = 3.0  # standard deviations: 0.3 % of a Gaussian lie beyond
_ROWS = 16  # that are computed at a time


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
        spots = _binned(aside / PIXEL_m, deep / PIXEL_m, spot / PIXEL_m, volume)
        tops.append(_tops(*spots, (across, rows)))
    dense, thin = (
        float(np.mean([_farthest(top, edge) for top in tops]))
        for edge in (PROJECTED_m, THIN_PROJECTED_m)
    )
    return dense, thin


def _binned(
    aside: Floats, deep: Floats, spot: Floats, volume: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """One spot for each pixel with parcels: mean place and width, and volume per area."""
    pixel = aside.astype(np.int64) * (int(deep.max()) + 1) + deep.astype(np.int64)
    at = np.unique(pixel, return_inverse=True)[1].reshape(-1)
    total = np.bincount(at, volume)
    x, y, wide = (np.bincount(at, volume * quantity) / total for quantity in (aside, deep, spot))
    return x, y, wide, total / PIXEL_m**2


def _farthest(top: Floats, edge: float) -> float:
    """Last distance at which the largest values of rows (R,) reach `edge`, linear between rows."""
    rows = np.flatnonzero(top > edge)
    if not rows.size:
        return 0.0
    row = int(rows[-1])
    above, below = float(top[row]), float(top[row + 1]) if row + 1 < len(top) else 0.0
    return PIXEL_m * (row + 0.5 + (above - edge) / (above - below))


def _tops(
    aside: Floats, deep: Floats, width: Floats, amount: Floats, shape: tuple[int, int]
) -> Floats:
    """Largest value of each row of an image (across, rows) of spots (N,); lengths in pixels.

    Rows are computed from the farthest one on, until one reaches `PROJECTED_m`.
    """
    across, rows = shape
    top = np.zeros(rows)
    for end in range(rows, 0, -_ROWS):
        part = slice(max(end - _ROWS, 0), end)
        covering = (deep + _CUT * width >= part.start) & (deep - _CUT * width < end)
        down = _weights(deep[covering], width[covering], rows).toarray()[:, part]
        sideways = _weights(aside[covering], width[covering], across)
        top[part] = (sideways.T @ (amount[covering, None] * down)).max(axis=0)
        if top[part].max() > PROJECTED_m:
            break
    return top


def _weights(at: Floats, width: Floats, count: int) -> csr_array:
    """Weights of the pixels for each spot (N, count), of sum 1."""
    low, high = np.floor([at - _CUT * width, at + _CUT * width]).astype(np.int64)[..., None]
    widest = int((high - low).max(initial=0)) + 1
    pixel = low + np.arange(widest)
    weights = np.exp(-0.5 * ((pixel + (0.5 - at[:, None])) / width[:, None]) ** 2)
    weights *= (pixel >= 0) & (pixel <= np.minimum(high, count - 1))
    weights /= weights.sum(axis=1, keepdims=True)
    places = (np.clip(pixel, 0, count - 1).reshape(-1), np.arange(len(at) + 1) * widest)
    return csr_array((weights.reshape(-1), *places), shape=(len(at), count))
