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
def receive(
    amounts: Floats,
    part: float,
    density: Floats,
    fuel: Floats,
    enthalpy: Floats,
    velocity: Floats,
) -> None:
    """Adds a part of the sources of mass, enthalpy and momentum (5, A, P, R) to the cells."""
    na, nt, nr = density.shape
    for k in range(na):
        for j in range(nt):
            for a in range(3):
                for i in range(nr):
                    before = density[k, j, i]
                    moving = velocity[a, k, j, i] * before + part * amounts[2 + a, k, j, i]
                    velocity[a, k, j, i] = moving / (before + part * amounts[0, k, j, i])
            for i in range(nr):
                density[k, j, i] += part * amounts[0, k, j, i]
                fuel[k, j, i] += part * amounts[0, k, j, i]
                enthalpy[k, j, i] += part * amounts[1, k, j, i]


@compiled
def finish(
    mass: Floats, volume: Floats, fields: Floats, force: Floats, density: Floats, moving: Floats
) -> None:
    """State after a step: density, fields (S, A, P, R) per volume, and velocity.

    Args:
        mass: (A, P, R) of the cells.
        volume: of the cells.
        fields: per mass; become those per volume.
        force: (3, A, P, R) on the cells in the step [N s].
        density: written.
        moving: (3, A, P, R) momentum per volume before the force; becomes the velocity.
    """
    na, nt, nr = mass.shape
    for k in range(na):
        for j in range(nt):
            for i in range(nr):
                density[k, j, i] = mass[k, j, i] / volume[k, j, i]
            for s in range(fields.shape[0]):
                for i in range(nr):
                    fields[s, k, j, i] *= density[k, j, i]
            for a in range(3):
                for i in range(nr):
                    pushed = moving[a, k, j, i] * volume[k, j, i] + force[a, k, j, i]
                    moving[a, k, j, i] = pushed / mass[k, j, i]


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
    g, u, line = np.empty((3, 3, nr)), np.empty((3, nr)), np.empty((3, nr + 1))
    for k in range(na):
        for j in range(nt):
            g[:] = 0.0
            here = velocity[:, k, j]
            for face in range(4):
                up = face % 2
                kk, jj = (k + 2 * up - 1, j) if face < 2 else (k, j + 2 * up - 1)
                area = faces[0][k + up, j] if face < 2 else faces[1][k, j + up]
                if kk < 0 or kk >= na or jj < 0 or jj >= nt:
                    for i in range(nr):
                        _along(here, i, area, u, i)
                else:
                    for a in range(3):
                        other = velocity[a, kk, jj]
                        for i in range(nr):
                            u[a, i] = 0.5 * (here[a, i] + other[i])
                for a in range(3):
                    for b in range(3):
                        part = (2 * up - 1) * area[b]
                        for i in range(nr):
                            g[a, b, i] += part * u[a, i] * strip[i]
            area = faces[2][k, j]
            _along(here, 0, area, line, 0)
            _along(here, nr - 1, area, line, nr)
            for a in range(3):
                for i in range(1, nr):
                    line[a, i] = 0.5 * (here[a, i - 1] + here[a, i])
                for i in range(nr + 1):
                    line[a, i] *= square[i]
                for b in range(3):
                    for i in range(nr):
                        g[a, b, i] += area[b] * (line[a, i + 1] - line[a, i])
            for i in range(nr):
                total = 2 * (g[0, 0, i] ** 2 + g[1, 1, i] ** 2 + g[2, 2, i] ** 2)
                total += (g[0, 1, i] + g[1, 0, i]) ** 2
                total += (g[0, 2, i] + g[2, 0, i]) ** 2
                total += (g[1, 2, i] + g[2, 1, i]) ** 2
                result[k, j, i] = np.sqrt(total) / volume[k, j, i]


@compiled
def _along(velocity: Floats, cell: int, area: Floats, result: Floats, at: int) -> None:
    """Velocity of a cell without its part across a wall."""
    across, norm = 0.0, 1e-300
    for a in range(3):
        across += velocity[a, cell] * area[a]
        norm += area[a] * area[a]
    for a in range(3):
        result[a, at] = velocity[a, cell] - across / norm * area[a]


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
