"""Operators on the staggered grid: divergence, gradient, velocities, shear, moving region.

All arrays have the shape of the grid. Faces and edges have the index of the cell above them: entry
i of a face array along an axis is the face between cells i - 1 and i. In a periodic box face 0 is
also the last one; in a closed one it is the wall, both the first and the last, without flux: a
neighbour beyond it is the cell itself, so that there is no gradient either. So both have the same
indices, and the operators are conservative.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.spray.flow.advection import lengthen, mean, neighbour
from cldit.spray.numba_typing import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STILL_M_S = 0.1  # slower gas counts as at rest


@compiled
def divergence(flux: Floats, spacing: float, result: Floats) -> None:
    """Divergence of a face field (3, X, Y, Z), into `result` (X, Y, Z)."""
    nx, ny, nz = result.shape
    for i in range(nx):
        ip = i + 1 if i + 1 < nx else 0
        for j in range(ny):
            jp = j + 1 if j + 1 < ny else 0
            for k in range(nz):
                kp = k + 1 if k + 1 < nz else 0
                out = flux[0, ip, j, k] - flux[0, i, j, k] + flux[1, i, jp, k] - flux[1, i, j, k]
                result[i, j, k] = (out + flux[2, i, j, kp] - flux[2, i, j, k]) / spacing


@compiled
def subtract_gradient(potential: Floats, spacing: float, closed: bool, flux: Floats) -> None:
    """Subtracts the gradient of a potential (X, Y, Z) from `flux` (3, X, Y, Z), not at walls."""
    nx, ny, nz = potential.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                here = potential[i, j, k]
                if i > 0 or not closed:
                    flux[0, i, j, k] -= (here - potential[i - 1, j, k]) / spacing
                if j > 0 or not closed:
                    flux[1, i, j, k] -= (here - potential[i, j - 1, k]) / spacing
                if k > 0 or not closed:
                    flux[2, i, j, k] -= (here - potential[i, j, k - 1]) / spacing


@compiled
def velocities(flux: Floats, density: Floats, result: Floats) -> None:
    """Velocities of the faces from mass flux (3, X, Y, Z) and density (X, Y, Z), into `result`."""
    nx, ny, nz = density.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                here = density[i, j, k]
                result[0, i, j, k] = 2.0 * flux[0, i, j, k] / (here + density[i - 1, j, k])
                result[1, i, j, k] = 2.0 * flux[1, i, j, k] / (here + density[i, j - 1, k])
                result[2, i, j, k] = 2.0 * flux[2, i, j, k] / (here + density[i, j, k - 1])


@compiled
def centred(velocity: Floats, result: Floats) -> None:
    """Velocity in the cells from that of faces (3, X, Y, Z), into `result` of the same shape."""
    nx, ny, nz = result.shape[1:]
    for i in range(nx):
        for j in range(ny):
            x, xp = velocity[0, i, j], velocity[0, (i + 1) % nx, j]
            y, yp = velocity[1, i, j], velocity[1, i, (j + 1) % ny]
            z = velocity[2, i, j]
            mean(x, xp, 1.0, result[0, i, j])
            mean(y, yp, 1.0, result[1, i, j])
            mean(z[: nz - 1], z[1:], 1.0, result[2, i, j, : nz - 1])
            result[2, i, j, nz - 1] = 0.5 * (z[nz - 1] + z[0])


@compiled
def shear(
    middle: Floats,
    spacing: float,
    closed: bool,
    first: int,
    last: int,
    result: Floats,
) -> None:
    """Norm of the strain rate, sqrt(2 S_ij S_ij), in the cells, from velocities (3, X, Y, Z).

    Gradients are central differences over two cells, one-sided at walls. `first` and `last` are the
    slab of the first axis to write in `result` (X, Y, Z).
    """
    nx, ny, nz = result.shape
    u, v, w = np.empty((ny, nz + 4)), np.empty((ny, nz + 4)), np.empty((ny, nz + 4))
    for i in range(first, last):
        a, p = neighbour(i - 1, nx, closed), neighbour(i + 1, nx, closed)
        lengthen(middle[0, i], closed, u)
        lengthen(middle[1, i], closed, v)
        lengthen(middle[2, i], closed, w)
        for j in range(ny):
            b, q = neighbour(j - 1, ny, closed), neighbour(j + 1, ny, closed)
            uz, vz, wz = u[j], v[j], w[j]
            ux, uxp = middle[0, a, j], middle[0, p, j]
            vx, vxp = middle[1, a, j], middle[1, p, j]
            wx, wxp = middle[2, a, j], middle[2, p, j]
            uy, uyp = middle[0, i, b], middle[0, i, q]
            vy, vyp = middle[1, i, b], middle[1, i, q]
            wy, wyp = middle[2, i, b], middle[2, i, q]
            for k in range(nz):
                xx, yy, zz = uxp[k] - ux[k], vyp[k] - vy[k], wz[k + 3] - wz[k + 1]
                xy = vxp[k] - vx[k] + uyp[k] - uy[k]
                xz = wxp[k] - wx[k] + uz[k + 3] - uz[k + 1]
                yz = wyp[k] - wy[k] + vz[k + 3] - vz[k + 1]
                total = 2 * (xx * xx + yy * yy + zz * zz) + xy * xy + xz * xz + yz * yz
                result[i, j, k] = np.sqrt(total) / (2 * spacing)


@compiled
def busy(velocity: Floats, low: Ints, high: Ints) -> float:
    """Largest sum of the three speeds of a cell, from velocities (3, X, Y, Z).

    `low` and `high` (3,) receive the bounds of the cells with a speed above STILL_M_S.
    """
    shape = velocity.shape[1:]
    top = 0.0
    for axis in range(3):
        low[axis] = shape[axis]
        high[axis] = 0
    for i in range(shape[0]):
        for j in range(shape[1]):
            for k in range(shape[2]):
                x = abs(velocity[0, i, j, k])
                y = abs(velocity[1, i, j, k])
                z = abs(velocity[2, i, j, k])
                top = max(top, x + y + z)
                if max(x, y, z) > STILL_M_S:
                    low[0] = min(low[0], i)
                    low[1] = min(low[1], j)
                    low[2] = min(low[2], k)
                    high[0] = max(high[0], i + 1)
                    high[1] = max(high[1], j + 1)
                    high[2] = max(high[2], k + 1)
    return top
