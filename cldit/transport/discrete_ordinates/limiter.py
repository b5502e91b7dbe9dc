"""Limiter of gradients within cells: sources stay positive, and sums of weights constant."""

import numpy as np
from numpy.typing import NDArray


def limit(gradient: NDArray[np.floating], light: NDArray[np.floating], boundaries: int) -> None:
    """Limits gradients (3, C, N) in place, so that no component is negative anywhere in a cell.

    The means of the cells (C, N), `light`, are conserved, as by the slope limiters of finite
    volumes (van Leer, J. Comput. Phys. 32, 1979). The excess of a component goes to the others of
    its group, the first `boundaries` ones from outside or those that the medium emits, by their
    shares of the light. So the sums of both groups keep their gradients, which are opposite in an
    isothermal cavity. If the others cannot take it, all gradients of the cell shrink by one factor.
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
