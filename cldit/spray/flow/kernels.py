"""Finite volumes on a staggered grid: rates of change from advection and diffusion.

All arrays have the grid's shape. Faces and edges carry the index of the cell above them: entry i of
a face array along an axis is the face between cells i - 1 and i, where -1 is the last cell. In a
periodic box that is the truth; in a closed one face 0 is the wall, both the first and the last, and
nothing passes. So one indexing serves both, and what one cell loses another gains.

Fluxes are second order in space and time where the field is smooth (Lax and Wendroff), and total
variation diminishing by van Leer's limiter, under a CFL number, summed over the axes, below 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.spray.flow.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EVEN = 1e-9  # relative difference of neighbours that is none
STILL_M_S = 0.1  # gas that is slower neither carries momentum nor makes eddies


@compiled
def _flow(speed: float, far: float, low: float, high: float, beyond: float) -> float:
    """Value that a flow carries from `low` to `high` (speed, in cells a step, above 0) or back."""
    rise = high - low
    if speed >= 0.0:
        behind = low - far
        up = low
        sign = 1.0
    else:
        behind = beyond - high
        up = high
        sign = -1.0
    if behind * rise <= 0.0:
        return up
    # van Leer's limiter of r = behind / rise is 2 r / (1 + r); half of it, times rise.
    slope = behind * rise / (behind + rise)
    return up + sign * (1.0 - abs(speed)) * slope


@compiled
def scalar_rates(
    fields: Floats,
    flux: Floats,
    density: Floats,
    exchange: Floats,
    step: float,
    spacing: float,
    closed: bool,
    rates: Floats,
) -> None:
    """Adds to `rates` (S, X, Y, Z) the change per second of density times `fields` (S, X, Y, Z).

    flux: mass fluxes (3, X, Y, Z) through the faces; exchange: diffusivity times density of the
    cells.
    """
    shape = density.shape
    for axis in range(3):
        di = 1 if axis == 0 else 0
        dj = 1 if axis == 1 else 0
        dk = 1 if axis == 2 else 0
        count = shape[axis]
        for i in range(shape[0]):
            for j in range(shape[1]):
                for k in range(shape[2]):
                    place = i * di + j * dj + k * dk
                    if closed and place == 0:
                        continue
                    # Negative indices wrap by themselves; only those beyond the end need care.
                    a, b, c = i - di, j - dj, k - dk
                    m = flux[axis, i, j, k]
                    even = True
                    for s in range(fields.shape[0]):
                        low = fields[s, a, b, c]
                        even = even and abs(fields[s, i, j, k] - low) <= EVEN * abs(low)
                    if even:  # most of the box
                        for s in range(fields.shape[0]):
                            through = m * 0.5 * (fields[s, i, j, k] + fields[s, a, b, c]) / spacing
                            rates[s, i, j, k] += through
                            rates[s, a, b, c] -= through
                        continue
                    mean = 0.5 * (density[i, j, k] + density[a, b, c])
                    speed = m / mean * step / spacing
                    share = 0.5 * (exchange[i, j, k] + exchange[a, b, c]) / spacing
                    p, q, r = i, j, k
                    if place + 1 < count:
                        p, q, r = i + di, j + dj, k + dk
                    elif not closed:
                        p, q, r = i * (1 - di), j * (1 - dj), k * (1 - dk)
                    u, v, w = a - di, b - dj, c - dk
                    if closed and place == 1:
                        u, v, w = a, b, c
                    for s in range(fields.shape[0]):
                        low = fields[s, a, b, c]
                        high = fields[s, i, j, k]
                        value = _flow(speed, fields[s, u, v, w], low, high, fields[s, p, q, r])
                        through = (m * value - share * (high - low)) / spacing
                        rates[s, i, j, k] += through
                        rates[s, a, b, c] -= through


@compiled
def divergence(flux: Floats, spacing: float, result: Floats) -> None:
    """Of a face field (3, X, Y, Z), into the cells."""
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
    """From a face field (3, X, Y, Z); not at the walls of a closed box."""
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
    """Of the faces, (3, X, Y, Z)."""
    nx, ny, nz = density.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                here = density[i, j, k]
                result[0, i, j, k] = 2.0 * flux[0, i, j, k] / (here + density[i - 1, j, k])
                result[1, i, j, k] = 2.0 * flux[1, i, j, k] / (here + density[i, j - 1, k])
                result[2, i, j, k] = 2.0 * flux[2, i, j, k] / (here + density[i, j, k - 1])


@compiled
def momentum_rates(
    along: int,
    velocity: Floats,
    flux: Floats,
    density: Floats,
    viscosity: Floats,
    step: float,
    spacing: float,
    closed: bool,
    low: Ints,
    high: Ints,
    rates: Floats,
) -> None:
    """Adds to `rates` (X, Y, Z) the change per second of the momentum along an axis.

    velocity (X, Y, Z) of the faces across that axis; flux (3, X, Y, Z); viscosity of the cells,
    Pa s. Only cells from `low` to below `high` are looked at. Walls slip, and take up what flows
    into them.
    """
    shape = density.shape
    ei = 1 if along == 0 else 0
    ej = 1 if along == 1 else 0
    ek = 1 if along == 2 else 0
    for axis in range(3):
        di = 1 if axis == 0 else 0
        dj = 1 if axis == 1 else 0
        dk = 1 if axis == 2 else 0
        count = shape[axis]
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    place = i * di + j * dj + k * dk
                    if closed and axis != along and place == 0:
                        continue
                    a, b, c = i - di, j - dj, k - dk
                    before = velocity[a, b, c]
                    after = velocity[i, j, k]
                    if abs(before) < STILL_M_S and abs(after) < STILL_M_S:
                        continue
                    # Along its own axis the flux is that through the middle of cell (a, b, c).
                    x, y, z = (a, b, c) if axis == along else (i - ei, j - ej, k - ek)
                    m = 0.5 * (flux[axis, i, j, k] + flux[axis, x, y, z])
                    if axis == along:
                        mean = density[a, b, c]
                        share = viscosity[a, b, c]
                    else:
                        mean = 0.5 * (density[i, j, k] + density[a, b, c])
                        share = 0.5 * (viscosity[i, j, k] + viscosity[a, b, c])
                    p, q, r = i, j, k
                    if place + 1 < count:
                        p, q, r = i + di, j + dj, k + dk
                    elif not closed or axis == along:
                        p, q, r = i * (1 - di), j * (1 - dj), k * (1 - dk)
                    u, v, w = a - di, b - dj, c - dk
                    if closed and place == 1 and axis != along:
                        u, v, w = a, b, c
                    speed = m / mean * step / spacing
                    value = _flow(speed, velocity[u, v, w], before, after, velocity[p, q, r])
                    through = (m * value - share / spacing * (after - before)) / spacing
                    rates[i, j, k] += through
                    rates[a, b, c] -= through


@compiled
def shear(
    velocity: Floats, spacing: float, closed: bool, low: Ints, high: Ints, result: Floats
) -> None:
    """Norm of the strain rate, sqrt(2 S_ij S_ij), in the cells, from the face velocities.

    Gradients across the flow are central differences over two cells, one-sided at walls.
    """
    shape = result.shape
    strain = np.empty((3, 3))
    centre = np.empty((2, 3))
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            for k in range(low[2], high[2]):
                result[i, j, k] = 0.0
                if (
                    max(
                        abs(velocity[0, i, j, k]),
                        abs(velocity[1, i, j, k]),
                        abs(velocity[2, i, j, k]),
                    )
                    < STILL_M_S
                ):
                    continue
                for axis in range(3):
                    place = i if axis == 0 else (j if axis == 1 else k)
                    count = shape[axis]
                    for side in range(2):
                        to = place + 2 * side - 1
                        if to < 0:
                            to = 0 if closed else count - 1
                        if to >= count:
                            to = count - 1 if closed else 0
                        x = to if axis == 0 else i
                        y = to if axis == 1 else j
                        z = to if axis == 2 else k
                        xp = x + 1 if x + 1 < shape[0] else 0
                        yp = y + 1 if y + 1 < shape[1] else 0
                        zp = z + 1 if z + 1 < shape[2] else 0
                        centre[side, 0] = 0.5 * (velocity[0, x, y, z] + velocity[0, xp, y, z])
                        centre[side, 1] = 0.5 * (velocity[1, x, y, z] + velocity[1, x, yp, z])
                        centre[side, 2] = 0.5 * (velocity[2, x, y, z] + velocity[2, x, y, zp])
                    for component in range(3):
                        rise = centre[1, component] - centre[0, component]
                        strain[component, axis] = 0.5 * rise / spacing
                total = 0.0
                for a in range(3):
                    for b in range(3):
                        total += 0.5 * (strain[a, b] + strain[b, a]) ** 2
                result[i, j, k] = np.sqrt(2.0 * total)


@compiled
def busy(velocity: Floats, low: Ints, high: Ints) -> float:
    """Largest sum of the three speeds of a cell; bounds of the cells where one is above
    STILL_M_S, into `low` and `high` (3,)."""
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
