"""Liquid penetration as the Engine Combustion Network defines it, by projected volume.

Its edge is a volume of liquid for each area that is looked at, in the mean of many injections. A
parcel is one sample of those: its droplets may be anywhere around it that eddies would have brought
them to. So each is seen as a Gaussian spot, half as wide as a free jet is at its distance from the
injector; then one injection shows what the mean of many does, and neither the number of parcels nor
the grid of the gas is seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.spray.flow.gasjet import HALF_WIDTH
from cldit.spray.numba_typing import compiled

Floats = NDArray[np.float64]

# 2.0e-3 and 0.2e-3 mm3/mm2
PROJECTED_m = 2.0e-6
THIN_PROJECTED_m = 0.2e-6
PIXEL_m = 0.5e-3
SPOT = 0.5 * HALF_WIDTH  # standard deviation, of the distance from the injector
_CUT = 3.0  # standard deviations


def projected_reach_m(position_m: Floats, volume_m3: Floats) -> tuple[float, float]:
    """How far the liquid reaches along the injector's axis (-z), by projected volume.

    The farthest distance at which the liquid on a line of sight across the axis, as a volume for
    each area, is still at an edge, `PROJECTED_m` and `THIN_PROJECTED_m`; 0 where it never is. The
    mean of two lines of sight, along x and y.

    Args:
        position_m: (N, 3) of parcels, from the injector's tip.
        volume_m3: (N,) of their liquid.

    Returns:
        Both distances [m].
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
        picture = np.zeros((across, rows))
        _paint(aside / PIXEL_m, deep / PIXEL_m, spot / PIXEL_m, volume / PIXEL_m**2, picture)
        tops.append(picture.max(axis=0))
    far, thin = (
        float(np.mean([_farthest(top, edge) for top in tops]))
        for edge in (PROJECTED_m, THIN_PROJECTED_m)
    )
    return far, thin


def _farthest(top: Floats, edge: float) -> float:
    """Where the rows' largest values (R,) last fall below an edge, linear between rows."""
    rows = np.flatnonzero(top > edge)
    if not rows.size:
        return 0.0
    row = int(rows[-1])
    here, below = float(top[row]), float(top[row + 1]) if row + 1 < len(top) else 0.0
    return PIXEL_m * (row + 0.5 + (here - edge) / (here - below))


@compiled
def _spot(at: float, width: float, weights: Floats) -> tuple[int, int]:
    """First and last pixel of a spot, and the pixels' weights, of sum 1."""
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
def _paint(across: Floats, down: Floats, width: Floats, amount: Floats, picture: Floats) -> None:
    """Adds spots (N,) to a picture (A, R); lengths in pixels."""
    aside, deep = np.empty(picture.shape[0]), np.empty(picture.shape[1])
    for n in range(across.shape[0]):
        first, last = _spot(across[n], width[n], aside)
        top, bottom = _spot(down[n], width[n], deep)
        for i in range(first, last + 1):
            part = amount[n] * aside[i]
            for k in range(top, bottom + 1):
                picture[i, k] += part * deep[k]
