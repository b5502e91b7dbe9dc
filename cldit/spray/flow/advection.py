"""Finite volumes on a staggered grid: advection and diffusion of the gas in a step.

Fluxes are third order along each axis, in space and time (QUICKEST: B. P. Leonard, Comput. Methods
Appl. Mech. Eng. 19, 59 (1979)), for a CFL number, summed over the axes, below 1. Mass fractions and
enthalpy are limited to the range of their neighbours (total variation diminishing, in Sweby's
region); velocity is not, since the limiter flattens maxima and so widens a jet across the grid.

One function computes the fluxes through a row of faces without branches, for vector instructions;
whole planes of the grid are one long row. `first` and `last` are the slab of the first axis of a
thread. Indices are those of `kernels`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.spray.numba_typing import compiled

Floats = NDArray[np.float64]


@compiled
def neighbour(i: int, count: int, closed: bool) -> int:
    """Index of one of `count` cells; `i` may be beyond the ends of a closed or periodic box."""
    if closed:
        return min(max(i, 0), count - 1)
    return i % count


@compiled
def _passing(
    flux: Floats,
    mass: Floats,
    share: Floats,
    ratio: float,
    bounded: bool,
    far: Floats,
    low: Floats,
    high: Floats,
    beyond: Floats,
    result: Floats,
) -> None:
    """Fluxes (K,) through the faces of a row, times the spacing's part in `ratio`.

    flux: of mass; mass: density at the face; share: diffusive flux per difference of the values;
    ratio: step over spacing; bounded: no new extrema. Values far, low | high, beyond on both sides
    of the face.
    """
    for k in range(result.shape[0]):
        # Both sides are read and computed, so that only selections remain.
        m, rho, d = flux[k], mass[k], share[k]
        t, x, y, z = far[k], low[k], high[k], beyond[k]
        onward = m >= 0.0
        speed = ratio * m / rho
        rise = y - x
        first, second = x - t, z - y
        behind = first if onward else second
        up = x if onward else y
        sign = 1.0 if onward else -1.0
        # Third order in r = behind / rise, within 0, 2 r and 2; half of it, times rise.
        third = rise - (1.0 + abs(speed)) / 3.0 * (rise - behind)
        most = min(2.0 * abs(behind), 2.0 * abs(rise))
        even = behind * rise <= 0.0
        part = 0.5 * min(abs(third), most)
        held = 0.0 if even else (part if rise > 0.0 else -part)
        slope = held if bounded else 0.5 * third
        result[k] = m * (up + (sign - speed) * slope) - d * rise


@compiled
def mean(one: Floats, other: Floats, factor: float, result: Floats) -> None:
    """Writes `factor` times the mean of `one` and `other`, (K,) or longer, into `result` (K,)."""
    for k in range(result.shape[0]):
        result[k] = 0.5 * factor * (one[k] + other[k])


@compiled
def _copy(row: Floats, result: Floats) -> None:
    """Copies a row element by element: for slices numba would also compile error messages."""
    for k in range(row.shape[0]):
        result[k] = row[k]


@compiled
def _close(plane: Floats, along: int, result: Floats) -> None:
    """Repeats the first row (along 0) or column (along 1) of a plane (Y, Z) at the end."""
    ny, nz = plane.shape
    for j in range(ny):
        _copy(plane[j], result[j])
        if along == 1:
            result[j, nz] = plane[j, 0]
    if along == 0:
        _copy(plane[0], result[ny])


@compiled
def _rows(plane: Floats, closed: bool, result: Floats) -> None:
    """Adds two rows at both ends of a plane (Y, Z), (Y + 4, Z)."""
    count = plane.shape[0]
    for j in range(count + 4):
        _copy(plane[neighbour(j - 2, count, closed)], result[j])


@compiled
def lengthen(plane: Floats, closed: bool, result: Floats) -> None:
    """Adds two values at both ends of the rows of a plane (Y, Z), into `result` (Y, Z + 4)."""
    count = plane.shape[1]
    for n in (0, 1, count + 2, count + 3):
        k = neighbour(n - 2, count, closed)
        for j in range(plane.shape[0]):
            result[j, n] = plane[j, k]
    for j in range(plane.shape[0]):
        _copy(plane[j], result[j, 2:])


@compiled
def _halves(flat: Floats, stride: int, along: bool, factor: float, result: Floats) -> None:
    """Means of the cells on both sides of the faces of a flat padded plane, times a factor.

    For volumes shifted along the axis it is the cell itself.
    """
    count = result.shape[0]
    low = flat[stride : count + stride]
    mean(low, low if along else flat[2 * stride : count + 2 * stride], factor, result)


@compiled
def _through(
    flux: Floats,
    mass: Floats,
    share: Floats,
    ratio: float,
    bounded: bool,
    flat: Floats,
    stride: int,
    result: Floats,
) -> None:
    """Fluxes as of `_passing` for a flat padded plane; stride: from a value to its neighbour."""
    n = result.shape[0]
    far, low = flat[:n], flat[stride : n + stride]
    high, beyond = flat[2 * stride : n + 2 * stride], flat[3 * stride : n + 3 * stride]
    _passing(flux, mass, share, ratio, bounded, far, low, high, beyond, result)


@compiled
def carry(
    fields: Floats,
    flux: Floats,
    density: Floats,
    exchange: Floats,
    step: float,
    spacing: float,
    closed: bool,
    first: int,
    last: int,
    result: Floats,
) -> None:
    """Adds the change of S fields in a step to `result` (S, X, Y, Z).

    Args:
        fields: (S, X, Y, Z) per mass.
        flux: (3, X, Y, Z) mass flux through the faces.
        density: (X, Y, Z).
        exchange: (X, Y, Z) diffusivity times density of the cells.
        step, spacing: length of the step [s], and of a cell [m].
        closed: with walls; else periodic.
        first, last: slab of the first axis.
        result: (S, X, Y, Z), added to.
    """
    nx, ny, nz = density.shape
    scalars, ratio, size = fields.shape[0], step / spacing, ny * nz
    mass, share = np.empty((ny + 1) * (nz + 4)), np.empty((ny + 1) * (nz + 4))
    rows, ends = np.empty((ny + 4, nz)), np.empty((ny, nz + 4))
    m_rows, m_ends = np.empty((ny + 1, nz)), np.zeros((ny, nz + 4))
    upright, flat = (ny + 1) * nz, ny * (nz + 4) - 3  # faces in such planes
    below = np.zeros((2, scalars, ny, nz))  # through the lower faces of this i and the next one
    beside, beyond = np.empty((scalars, ny + 1, nz)), np.empty((scalars, ny, nz + 4))
    for i in range(first, last + 1):
        now, face = i & 1, i % nx
        a, p = neighbour(i - 1, nx, closed), neighbour(i, nx, closed)
        u, v = neighbour(i - 2, nx, closed), neighbour(i + 1, nx, closed)
        mean(density[a].reshape(-1), density[p].reshape(-1), 1.0, mass[:size])
        mean(exchange[a].reshape(-1), exchange[p].reshape(-1), 1 / spacing, share[:size])
        for s in range(scalars):
            f = fields[s].reshape((nx, size))
            out = below[now, s].reshape(-1)
            m = flux[0, face].reshape(-1)
            _passing(m, mass[:size], share[:size], ratio, True, f[u], f[a], f[p], f[v], out)
        if i == first:
            continue
        c = i - 1  # the cells between the two planes of faces
        _close(flux[1, c], 0, m_rows)
        _rows(density[c], closed, rows)
        _halves(rows.reshape(-1), nz, False, 1.0, mass[:upright])
        _rows(exchange[c], closed, rows)
        _halves(rows.reshape(-1), nz, False, 1 / spacing, share[:upright])
        for s in range(scalars):
            _rows(fields[s, c], closed, rows)
            m, out = m_rows.reshape(-1), beside[s].reshape(-1)
            there = m, mass[:upright], share[:upright]
            _through(*there, ratio, True, rows.reshape(-1), nz, out)
        _close(flux[2, c], 1, m_ends)
        lengthen(density[c], closed, ends)
        _halves(ends.reshape(-1), 1, False, 1.0, mass[:flat])
        lengthen(exchange[c], closed, ends)
        _halves(ends.reshape(-1), 1, False, 1 / spacing, share[:flat])
        for s in range(scalars):
            lengthen(fields[s, c], closed, ends)
            m, out = m_ends.reshape(-1), beyond[s].reshape(-1)[:flat]
            there = m, mass[:flat], share[:flat]
            _through(*there, ratio, True, ends.reshape(-1), 1, out)
        for s in range(scalars):
            for j in range(ny):
                one, two = below[1 - now, s, j], below[now, s, j]
                three, four, five = beside[s, j], beside[s, j + 1], beyond[s, j]
                out = result[s, c, j]
                for k in range(nz):
                    gain = one[k] - two[k] + three[k] - four[k] + five[k] - five[k + 1]
                    out[k] += ratio * gain


@compiled
def _staggered(flux: Floats, i: int, along: int, result: Floats) -> None:
    """Mean (Y, Z) of the plane i of a face field and the same shifted by one cell along an axis."""
    ny, nz = result.shape
    if along == 0:
        mean(flux[i].reshape(-1), flux[i - 1].reshape(-1), 1.0, result.reshape(-1))
        return
    for j in range(ny):
        row, out = flux[i, j], result[j]
        if along == 1:
            mean(row, flux[i, j - 1], 1.0, out)
        else:
            out[0] = 0.5 * (row[0] + row[nz - 1])
            mean(row[1:], row[: nz - 1], 1.0, out[1:])


@compiled
def push(
    along: int,
    velocity: Floats,
    flux: Floats,
    density: Floats,
    viscosity: Floats,
    given: Floats,
    step: float,
    spacing: float,
    closed: bool,
    first: int,
    last: int,
    result: Floats,
) -> None:
    """Mass flux along an axis, which is momentum, after a step; walls slip and absorb.

    Args:
        along: the axis.
        velocity: (X, Y, Z) of the faces across that axis.
        viscosity: (X, Y, Z) of the cells [Pa s].
        given: (X, Y, Z) added momentum.
        flux, density, step, spacing, closed, first, last: as in `carry`.
        result: (X, Y, Z), overwritten.
    """
    nx, ny, nz = density.shape
    ratio, size = step / spacing, ny * nz
    mass, share = np.empty((ny + 1) * (nz + 4)), np.empty((ny + 1) * (nz + 4))
    rows, ends = np.empty((ny + 4, nz)), np.empty((ny, nz + 4))
    m, m_rows, m_ends = np.empty((ny, nz)), np.empty((ny + 1, nz)), np.zeros((ny, nz + 4))
    upright, flat = (ny + 1) * nz, ny * (nz + 4) - 3
    below = np.zeros((2, ny, nz))
    beside, beyond = np.empty((ny + 1, nz)), np.empty((ny, nz + 4))
    speeds = velocity.reshape((nx, size))
    # Along its own axis a face field is periodic, since the wall is its first and last entry; a
    # face of its volumes is the middle of the cell below.
    held = (closed and along != 0, closed and along != 1, closed and along != 2)
    for i in range(first, last + 1):
        now, face = i & 1, i % nx
        a, p = neighbour(i - 1, nx, held[0]), neighbour(i, nx, held[0])
        u, v = neighbour(i - 2, nx, held[0]), neighbour(i + 1, nx, held[0])
        q = a if along == 0 else p
        _staggered(flux[0], face, along, m)
        mean(density[a].reshape(-1), density[q].reshape(-1), 1.0, mass[:size])
        mean(viscosity[a].reshape(-1), viscosity[q].reshape(-1), 1 / spacing, share[:size])
        _passing(
            m.reshape(-1),
            mass[:size],
            share[:size],
            ratio,
            False,
            speeds[u],
            speeds[a],
            speeds[p],
            speeds[v],
            below[now].reshape(-1),
        )
        if i == first:
            continue
        c = i - 1
        _staggered(flux[1], c, along, m)
        _close(m, 0, m_rows)
        _rows(density[c], held[1], rows)
        _halves(rows.reshape(-1), nz, along == 1, 1.0, mass[:upright])
        _rows(viscosity[c], held[1], rows)
        _halves(rows.reshape(-1), nz, along == 1, 1 / spacing, share[:upright])
        _rows(velocity[c], held[1], rows)
        there = m_rows.reshape(-1), mass[:upright], share[:upright]
        _through(*there, ratio, False, rows.reshape(-1), nz, beside.reshape(-1))
        _staggered(flux[2], c, along, m)
        _close(m, 1, m_ends)
        lengthen(density[c], held[2], ends)
        _halves(ends.reshape(-1), 1, along == 2, 1.0, mass[:flat])
        lengthen(viscosity[c], held[2], ends)
        _halves(ends.reshape(-1), 1, along == 2, 1 / spacing, share[:flat])
        lengthen(velocity[c], held[2], ends)
        there = m_ends.reshape(-1), mass[:flat], share[:flat]
        _through(*there, ratio, False, ends.reshape(-1), 1, beyond.reshape(-1)[:flat])
        for j in range(ny):
            one, two = below[1 - now, j], below[now, j]
            three, four, five = beside[j], beside[j + 1], beyond[j]
            before, more, out = flux[along, c, j], given[c, j], result[c, j]
            for k in range(nz):
                gain = one[k] - two[k] + three[k] - four[k] + five[k] - five[k + 1]
                out[k] = before[k] + more[k] + ratio * gain
