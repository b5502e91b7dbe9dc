"""Exchange between parcels and grid: cloud in cell (trilinear), with equal weights both ways.

`shift` is the position of a field's values, in cells from the lower corner of theirs: 0.5 along an
axis for the middle, 0 for the lower face.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.spray.flow.gas import FlowGrid
from cldit.spray.numba_typing import compiled

Floats = NDArray[np.float64]

CENTRE = (0.5, 0.5, 0.5)
FACES = ((0.0, 0.5, 0.5), (0.5, 0.0, 0.5), (0.5, 0.5, 0.0))


@compiled
def _place(at: float, shift: float, count: int, closed: bool) -> tuple[int, int, float]:
    """Two neighbours along an axis, and the weight of the second."""
    x = at - shift
    if closed:
        # Positions between the last values and the wall belong to these; walls have no values.
        first = 0.0 if shift > 0 else 1.0
        x = min(max(x, first), count - 1.0)
    low = int(np.floor(x))
    part = x - low
    if closed:
        return low, min(low + 1, count - 1), part
    return low % count, (low + 1) % count, part


@compiled
def _gather(
    at: Floats, shift: Floats, closed: bool, field: Floats, scale: float, result: Floats
) -> None:
    nx, ny, nz = field.shape
    for n in range(at.shape[0]):
        i, ip, u = _place(at[n, 0] * scale, shift[0], nx, closed)
        j, jp, v = _place(at[n, 1] * scale, shift[1], ny, closed)
        k, kp, w = _place(at[n, 2] * scale, shift[2], nz, closed)
        low = (1 - v) * (field[i, j, k] * (1 - w) + field[i, j, kp] * w)
        low += v * (field[i, jp, k] * (1 - w) + field[i, jp, kp] * w)
        high = (1 - v) * (field[ip, j, k] * (1 - w) + field[ip, j, kp] * w)
        high += v * (field[ip, jp, k] * (1 - w) + field[ip, jp, kp] * w)
        result[n] = (1 - u) * low + u * high


@compiled
def _scatter(
    at: Floats, shift: Floats, closed: bool, values: Floats, scale: float, field: Floats
) -> None:
    nx, ny, nz = field.shape
    for n in range(at.shape[0]):
        i, ip, u = _place(at[n, 0] * scale, shift[0], nx, closed)
        j, jp, v = _place(at[n, 1] * scale, shift[1], ny, closed)
        k, kp, w = _place(at[n, 2] * scale, shift[2], nz, closed)
        low, high = values[n] * (1 - u), values[n] * u
        field[i, j, k] += low * (1 - v) * (1 - w)
        field[i, j, kp] += low * (1 - v) * w
        field[i, jp, k] += low * v * (1 - w)
        field[i, jp, kp] += low * v * w
        field[ip, j, k] += high * (1 - v) * (1 - w)
        field[ip, j, kp] += high * (1 - v) * w
        field[ip, jp, k] += high * v * (1 - w)
        field[ip, jp, kp] += high * v * w


def gather(
    box: FlowGrid, position_m: Floats, field: Floats, shift: tuple[float, float, float] = CENTRE
) -> Floats:
    """Values (N,) of a field (X, Y, Z) at positions (N, 3)."""
    result = np.empty(len(position_m))
    _gather(
        position_m - box.origin_m, np.array(shift), box.closed, field, 1 / box.spacing_m, result
    )
    return result


def scatter(
    box: FlowGrid, position_m: Floats, amounts: Floats, shift: tuple[float, float, float] = CENTRE
) -> Floats:
    """Amounts (N,) at positions (N, 3) as a field (X, Y, Z), per volume; conservative."""
    field = np.zeros(box.shape)
    _scatter(
        position_m - box.origin_m,
        np.array(shift),
        box.closed,
        amounts / box.cell_m3,
        1 / box.spacing_m,
        field,
    )
    return field
