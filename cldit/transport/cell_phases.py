"""Phase function of each cell, where classes of droplet size have one each."""

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import TransportError
from cldit.transport.cells import OpticalCells
from cldit.transport.phase import ScatteringTable


def class_shares(cells: OpticalCells, phase: ScatteringTable | None) -> NDArray[np.uint8] | None:
    """Shares (K - 1, P) of classes of droplet size, see `Octree.shares`; None: one class.

    Raises TransportError if the phase function and the octree differ in their number of classes.
    """
    if phase is None or phase.classes is None:
        return None
    shares, classes = cells.tree.shares, len(phase.tables)
    if shares is None or len(shares) != classes - 1:
        count = 1 if shares is None else len(shares) + 1
        raise TransportError(
            f"the phase function has {classes} classes of droplet size and the octree {count}; "
            "allowed: equal numbers"
        )
    return shares


def class_weights(cells: OpticalCells, phase: ScatteringTable) -> Floats | None:
    """Share (K, P) of each class in the droplets' scattering of a cell; None: one class."""
    shares = class_shares(cells, phase)
    if shares is None:
        return None
    ends = np.vstack([np.zeros(shares.shape[1]), shares, np.full(shares.shape[1], 255.0)])
    return np.asarray(np.diff(ends, axis=0) / 255.0)


def phase_moments(cells: OpticalCells, phase: ScatteringTable, count: int) -> Floats:
    """First `count` Legendre moments (M, N) of the phase function in each scattering cell.

    Moment 0 is 1 and moment 1 is g. The shape is (M, 1) if all cells have one phase function.
    """
    moments = np.stack([table.moments(count) for table in phase.tables], axis=1)
    weights = class_weights(cells, phase)
    return moments if weights is None else moments @ weights[:, cells.address]
