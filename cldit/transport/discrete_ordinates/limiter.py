"""Limits of gradients within cells, which keep sources above 0 and sums of weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def limit(gradient: NDArray[np.floating], light: NDArray[np.floating], boundaries: int) -> None:
    """Limits gradients (3, C, N) in place, so that no component is negative anywhere in a cell.

    A cell's means are kept, as by the slope limiters of finite volumes (van Leer, J. Comput. Phys.
    32, 1979). What limiting takes from a component the others from the boundary, or the others that
    begin in the medium, get by their shares of the light, so that both sums change as they did: in
    an isothermal cavity they change oppositely. Where the others cannot take it, all gradients of
    the cell shrink alike.

    Args:
        gradient: (3, C, N) along x, y, z.
        light: (C, N) mean of each cell.
        boundaries: components that enter from outside, the first ones.
    """
    mean = np.maximum(light, 0)
    for some in (slice(boundaries), slice(boundaries, None)):
        total = mean[some].sum(axis=0)
        gradient *= _allowed(np.abs(gradient[:, some].sum(axis=1)).sum(axis=0), total)
    for some in (slice(boundaries), slice(boundaries, None)):
        part, own = mean[some], gradient[:, some]
        total, change = part.sum(axis=0), own.sum(axis=1)
        own *= _allowed(np.abs(own).sum(axis=0), part)
        share = np.divide(part, total, out=np.zeros_like(part), where=total > 0)
        own += (change - own.sum(axis=1))[:, None] * share
    if len(mean):
        gradient *= _allowed(np.abs(gradient).sum(axis=0), mean).min(axis=0)


def _allowed(steepness: NDArray[np.floating], mean: NDArray[np.floating]) -> NDArray[np.floating]:
    """Factors up to 1 with which sums of |gradient| along the axes are at most twice the mean."""
    most = 2 * mean
    return np.asarray(np.divide(most, steepness, out=np.ones_like(most), where=steepness > most))
