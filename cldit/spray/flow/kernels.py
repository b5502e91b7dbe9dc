"""Operators on the grid of rays: mass fluxes of the faces, forces of a potential, shear.

Velocity and momentum are in the cells, with the three axes of the grid's frame, so that momentum
has conservation form. Fluxes of mass are on the lower faces of the cells. Side faces have the area
of unit radius times the strip of their cell.
"""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats
from cldit.spray.numba_typing import compiled


@compiled
def fluxes(
    momentum: Floats,
    faces: tuple[Floats, Floats, Floats],
    strip: Floats,
    square: Floats,
    result: Floats,
) -> None:
    """Mass fluxes (3, A, P, R) of the lower faces, from the momentum per volume of the cells."""
    na, nt, nr = result.shape[1:]
    around, down, outward = faces
    for k in range(na):
        for j in range(nt):
            x, y, z = momentum[0, k, j], momentum[1, k, j], momentum[2, k, j]
            for i in range(nr):
                if k > 0:
                    area = around[k, j]
                    u = area[0] * (x[i] + momentum[0, k - 1, j, i])
                    u += area[1] * (y[i] + momentum[1, k - 1, j, i])
                    result[0, k, j, i] = 0.5 * strip[i] * u
                if j > 0:
                    area = down[k, j]
                    u = area[0] * (x[i] + momentum[0, k, j - 1, i])
                    u += area[1] * (y[i] + momentum[1, k, j - 1, i])
                    u += area[2] * (z[i] + momentum[2, k, j - 1, i])
                    result[1, k, j, i] = 0.5 * strip[i] * u
                if i > 0:
                    area = outward[k, j]
                    u = area[0] * (x[i] + x[i - 1]) + area[1] * (y[i] + y[i - 1])
                    u += area[2] * (z[i] + z[i - 1])
                    result[2, k, j, i] = 0.5 * square[i] * u


@compiled
def outflow(around: Floats, down: Floats, outward: Floats, result: Floats) -> None:
    """Mass (A, P, R) that leaves each cell [kg/s], from the fluxes of the lower faces."""
    na, nt, nr = result.shape
    for k in range(na):
        for j in range(nt):
            for i in range(nr):
                out = -around[k, j, i] - down[k, j, i] - outward[k, j, i]
                if k + 1 < na:
                    out += around[k + 1, j, i]
                if j + 1 < nt:
                    out += down[k, j + 1, i]
                if i + 1 < nr:
                    out += outward[k, j, i + 1]
                result[k, j, i] = out


@compiled
def correct(
    potential: Floats,
    faces: tuple[Floats, Floats, Floats],
    conductance: tuple[Floats, Floats, Floats],
    angle: Floats,
    strip: Floats,
    length: Floats,
    square: Floats,
    flux: Floats,
    force: Floats,
) -> None:
    """Subtracts the gradient of a potential from the fluxes; its force on each cell (3, A, P, R).

    The force is that of the mean potential on all faces of a cell, walls included; `length` is
    strip over radius.
    """
    na, nt, nr = potential.shape
    around, down, outward = faces
    for k in range(na):
        for j in range(nt):
            for i in range(nr):
                here = potential[k, j, i]
                side = strip[i]
                fx, fy, fz = 0.0, 0.0, 0.0
                other = here
                if k > 0:
                    other = potential[k - 1, j, i]
                    flux[0, k, j, i] -= conductance[0][k, j] * length[i] * (here - other)
                p = 0.5 * (here + other) * side
                fx += p * around[k, j, 0]
                fy += p * around[k, j, 1]
                other = potential[k + 1, j, i] if k + 1 < na else here
                p = 0.5 * (here + other) * side
                fx -= p * around[k + 1, j, 0]
                fy -= p * around[k + 1, j, 1]
                other = here
                if j > 0:
                    other = potential[k, j - 1, i]
                    flux[1, k, j, i] -= conductance[1][k, j] * length[i] * (here - other)
                p = 0.5 * (here + other) * side
                fx += p * down[k, j, 0]
                fy += p * down[k, j, 1]
                fz += p * down[k, j, 2]
                other = potential[k, j + 1, i] if j + 1 < nt else here
                p = 0.5 * (here + other) * side
                fx -= p * down[k, j + 1, 0]
                fy -= p * down[k, j + 1, 1]
                fz -= p * down[k, j + 1, 2]
                other = here
                if i > 0:
                    other = potential[k, j, i - 1]
                    flux[2, k, j, i] -= angle[k, j] * conductance[2][i] * (here - other)
                p = 0.5 * (here + other) * square[i]
                other = potential[k, j, i + 1] if i + 1 < nr else here
                p -= 0.5 * (here + other) * square[i + 1]
                force[0, k, j, i] = fx + p * outward[k, j, 0]
                force[1, k, j, i] = fy + p * outward[k, j, 1]
                force[2, k, j, i] = fz + p * outward[k, j, 2]


@compiled
def shear(
    velocity: Floats,
    faces: tuple[Floats, Floats, Floats],
    strip: Floats,
    square: Floats,
    volume: Floats,
    result: Floats,
) -> None:
    """Norm of the strain rate, sqrt(2 S_ij S_ij), in the cells, from their velocity (3, A, P, R).

    Gradients are by the theorem of Gauss. At walls the velocity has no part across them.
    """
    na, nt, nr = result.shape
    u, g, area = np.empty(3), np.empty((3, 3)), np.empty(3)
    for k in range(na):
        for j in range(nt):
            for i in range(nr):
                for a in range(3):
                    for b in range(3):
                        g[a, b] = 0.0
                for face in range(6):
                    axis, up = face // 2, face % 2
                    kk, jj, ii = k, j, i
                    size = strip[i]
                    if axis == 0:
                        kk += 2 * up - 1
                        area[:] = faces[0][k + up, j]
                    elif axis == 1:
                        jj += 2 * up - 1
                        area[:] = faces[1][k, j + up]
                    else:
                        ii += 2 * up - 1
                        area[:] = faces[2][k, j]
                        size = square[i + up]
                    wall = kk < 0 or kk >= na or jj < 0 or jj >= nt or ii < 0 or ii >= nr
                    if wall:
                        across, norm = 0.0, 1e-300
                        for a in range(3):
                            across += velocity[a, k, j, i] * area[a]
                            norm += area[a] * area[a]
                        for a in range(3):
                            u[a] = velocity[a, k, j, i] - across / norm * area[a]
                    else:
                        for a in range(3):
                            u[a] = 0.5 * (velocity[a, k, j, i] + velocity[a, kk, jj, ii])
                    size *= 2 * up - 1
                    for a in range(3):
                        for b in range(3):
                            g[a, b] += u[a] * area[b] * size
                total = 2 * (g[0, 0] ** 2 + g[1, 1] ** 2 + g[2, 2] ** 2)
                total += (g[0, 1] + g[1, 0]) ** 2
                total += (g[0, 2] + g[2, 0]) ** 2
                total += (g[1, 2] + g[2, 1]) ** 2
                result[k, j, i] = np.sqrt(total) / volume[k, j, i]


@compiled
def renewal(flux: Floats, mass: Floats) -> float:
    """Largest share of its mass that a cell passes on along its ray, per second."""
    na, nt, nr = mass.shape
    top = 0.0
    for k in range(na):
        for j in range(nt):
            for i in range(nr):
                c = abs(flux[2, k, j, i])
                if i + 1 < nr:
                    c = max(c, abs(flux[2, k, j, i + 1]))
                top = max(top, c / mass[k, j, i])
    return top
