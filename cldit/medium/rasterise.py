"""Conservative deposition of clouds of droplets in cells, compiled.

A cloud has a position, a covariance and a triangular profile (a box convolved with itself), whose
support is finite: 2.45 standard deviations. It is divided along z first, then each layer along y,
then each row along x, by differences of the integral of the profile, whose sum is 1 for any cells.
Position and covariance of the next division follow by regression on the coordinates known so far,
as for a normal distribution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.medium.frame import BRICK
from cldit.spray.numba_typing import compiled

REACH = 6.0**0.5  # half the width of the profile, in standard deviations
_LEAST = 1e-8  # in cells squared: variance of a point


@compiled
def _part(low: float, high: float) -> tuple[float, float, float]:
    """Share of a profile of unit variance in an interval, and its mean and variance there."""
    u, v = max(low / REACH, -1.0), min(high / REACH, 1.0)
    if v <= u:
        return 0.0, 0.0, 0.0
    share = first = second = 0.0
    if u < 0.0:
        w = min(v, 0.0)
        share += (w - u) + (w * w - u * u) / 2
        first += (w * w - u * u) / 2 + (w**3 - u**3) / 3
        second += (w**3 - u**3) / 3 + (w**4 - u**4) / 4
    if v > 0.0:
        w = max(u, 0.0)
        share += (v - w) - (v * v - w * w) / 2
        first += (v * v - w * w) / 2 - (v**3 - w**3) / 3
        second += (v**3 - w**3) / 3 - (v**4 - w**4) / 4
    if share <= 1e-12:
        return max(share, 0.0), (u + v) / 2 * REACH, 0.0
    mean = first / share
    return share, mean * REACH, max(second / share - mean * mean, 0.0) * REACH * REACH


@compiled
def rasterise(
    place: Floats,
    covariance: Floats,
    amount: Floats,
    directory: NDArray[np.int32],
    cells: int,
    marking: bool,
    mark: Mask,
    target: Floats,
) -> None:
    """Adds each cloud's amounts to the stored cells, or marks the bricks that clouds reach.

    Args:
        place: (N, 3) in cells from the lower corner, x, y, z. covariance: (N, 3, 3) in cells^2.
        amount: (N, A). directory: (nb, nb, nb), slot of each brick. cells: along an edge; the
            outermost cells receive the amounts beyond them.
        marking: bricks are marked in mark (nb, nb, nb), and nothing is added.
        target: (A, slots * 512), added to.
    """
    kinds = amount.shape[1]
    for n in range(place.shape[0]):
        zz = covariance[n, 2, 2] + _LEAST
        yy, zy = covariance[n, 1, 1] + _LEAST, covariance[n, 2, 1]
        xx, zx, yx = covariance[n, 0, 0] + _LEAST, covariance[n, 2, 0], covariance[n, 1, 0]
        on_z = zy / zz
        rest_y = max(yy - on_z * zy, _LEAST)
        # Regression of x on z and on the part of y that z does not explain.
        on_z_x = zx / zz
        on_y_x = (yx - on_z * zx) / rest_y
        rest_x = max(xx - on_z_x * zx - on_y_x * on_y_x * rest_y, _LEAST)
        sigma_z = zz**0.5
        z_first = int(np.floor(place[n, 2] - REACH * sigma_z))
        z_last = int(np.floor(place[n, 2] + REACH * sigma_z))
        for z in range(z_first, z_last + 1):
            low = (z - place[n, 2]) / sigma_z
            high = low + 1.0 / sigma_z
            if z_first == z_last:
                low, high = -REACH, REACH
            share_z, mean_z, within_z = _part(low, high)
            if share_z <= 0.0:
                continue
            mean_z *= sigma_z
            within_z *= zz
            cell_z = min(max(z, 0), cells - 1)
            middle_y = place[n, 1] + on_z * mean_z
            var_y = rest_y + on_z * on_z * within_z
            sigma_y = var_y**0.5
            y_first = int(np.floor(middle_y - REACH * sigma_y))
            y_last = int(np.floor(middle_y + REACH * sigma_y))
            for y in range(y_first, y_last + 1):
                low = (y - middle_y) / sigma_y
                high = low + 1.0 / sigma_y
                if y_first == y_last:
                    low, high = -REACH, REACH
                share_y, mean_y, within_y = _part(low, high)
                share_y *= share_z
                if share_y <= 0.0:
                    continue
                mean_y *= sigma_y
                within_y *= var_y
                cell_y = min(max(y, 0), cells - 1)
                # z and the rest of y, for this layer and row.
                gain_z, gain_y = on_z * within_z / var_y, rest_y / var_y
                shift = on_z_x * (mean_z + gain_z * mean_y) + on_y_x * gain_y * mean_y
                middle_x = place[n, 0] + shift
                slope = on_z_x * gain_z + on_y_x * gain_y
                known = on_z_x * on_z_x * within_z + on_y_x * on_y_x * rest_y
                var_x = rest_x + max(known - slope * slope * (var_y - within_y), 0.0)
                sigma_x = var_x**0.5
                x_first = int(np.floor(middle_x - REACH * sigma_x))
                x_last = int(np.floor(middle_x + REACH * sigma_x))
                brick_z, brick_y = cell_z // BRICK, cell_y // BRICK
                if marking:
                    first = min(max(x_first, 0), cells - 1) // BRICK
                    last = min(max(x_last, 0), cells - 1) // BRICK
                    for brick in range(first, last + 1):
                        mark[brick_z, brick_y, brick] = True
                    continue
                row = ((cell_z % BRICK) * BRICK + cell_y % BRICK) * BRICK
                for x in range(x_first, x_last + 1):
                    share = share_y
                    if x_first != x_last:
                        low = (x - middle_x) / sigma_x
                        share *= _part(low, low + 1.0 / sigma_x)[0]
                    cell_x = min(max(x, 0), cells - 1)
                    slot = directory[brick_z, brick_y, cell_x // BRICK]
                    at = slot * (BRICK * BRICK * BRICK) + row + cell_x % BRICK
                    for kind in range(kinds):
                        target[kind, at] += share * amount[n, kind]
