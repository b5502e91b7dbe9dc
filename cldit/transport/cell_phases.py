"""How each cell scatters, where droplets have several phase functions by class of size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.errors import TransportError
from cldit.transport.cells import OpticalCells
from cldit.transport.phase import ScatteringTable

Floats = NDArray[np.float64]


def class_shares(cells: OpticalCells, phase: ScatteringTable | None) -> NDArray[np.uint8] | None:
    """Shares (K - 1, P) of classes of droplet size, see `Octree.shares`.

    Args:
        cells: the medium.
        phase: how droplets scatter.

    Returns:
        The shares; None where one phase function holds for all cells.

    Raises:
        TransportError: the phase function has other classes than the octree.
    """
    if phase is None or phase.classes is None:
        return None
    shares, classes = cells.tree.shares, len(phase.tables)
    if shares is None or len(shares) != classes - 1:
        found = 1 if shares is None else len(shares) + 1
        raise TransportError(
            f"phase function of {classes} classes of droplet size, and an octree with {found}; "
            "allowed is as many"
        )
    return shares


def class_weights(cells: OpticalCells, phase: ScatteringTable) -> Floats | None:
    """Share (K, P) of what each class scatters of all that droplets scatter in a cell.

    Args:
        cells, phase: as in `class_shares`.

    Returns:
        The shares; None where one phase function holds for all cells.
    """
    shares = class_shares(cells, phase)
    if shares is None:
        return None
    ends = np.vstack([np.zeros(shares.shape[1]), shares, np.full(shares.shape[1], 255.0)])
    return np.asarray(np.diff(ends, axis=0) / 255.0)


def phase_moments(cells: OpticalCells, phase: ScatteringTable, count: int) -> Floats:
    """Legendre moments of the phase function in each scattering cell.

    Args:
        cells, phase: as in `class_shares`.
        count: M, the number of moments; moment 0 is 1 and moment 1 is g.

    Returns:
        (M, N); (M, 1) where one phase function holds for all cells.
    """
    moments = np.stack([table.moments(count) for table in phase.tables], axis=1)
    weights = class_weights(cells, phase)
    return moments if weights is None else moments @ weights[:, cells.address]
