"""Results of the grid of rays: all plumes, and vapour on two regular lattices."""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats, Ints, Mask
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.exchange import between, corners, turn_of
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.rays import RayGrid
from cldit.spray.numba_typing import compiled
from cldit.spray.result import Cells, Vapour

NEGLIGIBLE = 1e-6  # mass fraction of vapour below which cells are omitted from the result
SPACING_m = 0.5e-3  # of the lattice, whatever the grid is
_NEAR_m = 10e-3  # of the tip, where plumes are narrower than 2 mm: half of the spacing
_FAINT = 0.1  # of NEGLIGIBLE, which is added to voxels
_MOST = 240  # voxels along an axis
_AVOGADRO = 6.02214076e23


def sampled(flow: GasFlow, fuel: Fuel) -> Vapour | None:
    """Vapour on lattices, linear between the middles of the cells of rays.

    The vapour in each shell of cells is kept. Temperatures are means by mass of vapour.
    """
    grid = flow.grid
    vapour = flow.read("fuel")
    content = np.sum(vapour * grid.volume_m3, axis=(0, 1)) * grid.copies
    rich = flow.read("share") >= NEGLIGIBLE
    if not rich.any():
        return None
    low, high = _bounds(grid, rich)
    spacing_m = max(SPACING_m, float(np.max(high - low)) / _MOST)
    origin = spacing_m * (np.floor(low / spacing_m) - 1)
    shape = np.ceil((high - origin) / spacing_m).astype(np.int64) + 2
    # The lattice, and one of half the spacing in its place near the tip.
    near = np.rint((np.array([[-1.0], [1.0]]) * _NEAR_m - origin) / spacing_m)
    near = np.clip(near, 0, shape).astype(np.int64)
    lattices = (
        (origin, spacing_m, np.zeros((2, *shape)), near),
        (
            origin + near[0] * spacing_m,
            0.5 * spacing_m,
            np.zeros((2, *(2 * (near[1] - near[0])))),
            np.zeros_like(near),
        ),
    )
    least = _FAINT * NEGLIGIBLE * flow.far_density_kg_m3
    cosines = _cosines(grid, vapour >= 0.1 * least)
    shells, factor = np.zeros(len(content)), np.ones(len(content))
    for again in (False, True):
        if again:
            factor = np.divide(content, shells, out=np.zeros_like(content), where=shells > 0)
        for corner, edge_m, found, without in lattices:
            found[:] = 0.0
            _fill(
                (grid.frame, grid.azimuth, grid.polar, grid.radius_m, grid.symmetry),
                vapour,
                flow.read("temperature"),
                least,
                cosines,
                factor,
                corner,
                edge_m,
                without,
                shells,
                found,
            )
    lower, upper, number, warm = [], [], [], []
    for corner, edge_m, found, _ in lattices:
        mass, heat = found.reshape(2, -1)
        index = np.flatnonzero(mass > NEGLIGIBLE * flow.far_density_kg_m3 * edge_m**3)
        steps = np.stack(np.unravel_index(index, found.shape[1:]), axis=1)
        lower.append(corner + steps * edge_m)
        upper.append(corner + (steps + 1) * edge_m)
        number.append(mass[index] / edge_m**3 * (_AVOGADRO / fuel.molar_mass_kg_mol))
        warm.append(heat[index] / mass[index])
    return Vapour(
        cells=Cells(np.concatenate(lower), np.concatenate(upper)),
        number_density_m3=np.concatenate(number),
        temperature_K=np.concatenate(warm),
        molar_mass_kg_mol=fuel.molar_mass_kg_mol,
    )


def _cosines(grid: RayGrid, rich: Mask) -> Floats:
    """Least and largest cosine of the polar angle (2, R) at which a shell, or one beside it, has
    rich cells (A, P, R), with a cell more on both sides."""
    any_ = np.asarray(rich.any(axis=0))
    any_[:, 1:] |= any_[:, :-1].copy()
    any_[:, :-1] |= any_[:, 1:].copy()
    count = len(any_)
    first, last = any_.argmax(axis=0), count - 1 - any_[::-1].argmax(axis=0)
    some = any_.any(axis=0)
    low = np.cos(grid.polar[np.minimum(last + 2, count)])
    high = np.cos(grid.polar[np.maximum(first - 1, 0)])
    return np.stack([np.where(some, low, 2.0), np.where(some, high, -2.0)])


def _bounds(grid: RayGrid, rich: Mask) -> tuple[Floats, Floats]:
    """Corners of a box around the cells that are rich (A, P, R), and their copies."""
    far = np.where(rich, grid.radius_m[1:], 0.0).max(axis=2)
    rays = grid.directions @ grid.frame.T * far[:, :, None]
    rays = rays[far > 0]
    if grid.symmetry != 1:
        wide = np.hypot(rays[:, 0], rays[:, 1])
        around = np.linspace(0.0, 2 * np.pi, 65)
        ends = zip(wide, rays[:, 2], strict=True)
        ring = np.stack([np.cos(around), np.sin(around)])
        rays = np.concatenate([np.stack([*(w * ring), np.full(65, h)], axis=1) for w, h in ends])
    world = rays @ grid.frame
    return np.minimum(world.min(axis=0), 0.0), np.maximum(world.max(axis=0), 0.0)


@compiled
def _fill(
    grid: tuple[Floats, Floats, Floats, Floats, int],
    fuel: Floats,
    temperature: Floats,
    least: float,
    cosines: Floats,
    factor: Floats,
    origin: Floats,
    spacing: float,
    without: Ints,
    shells: Floats,
    result: Floats,
) -> None:
    """Mass of vapour, and that times its temperature, of voxels (2, X, Y, Z).

    Args:
        grid: frame, azimuth, polar, radius_m and symmetry of a `RayGrid`.
        fuel, temperature: of its cells.
        least: density of vapour below which there is none.
        cosines: (2, R) bounds of the polar angle's within which each shell has vapour.
        factor: (R,) on what is found in each shell.
        origin, spacing: of the voxels.
        without: (2, 3) first voxel, and the one after the last, of a box without any.
        shells: (R,) sum of what is found without the factor; added to.
        result: added to.
    """
    frame, azimuth, polar, radius, symmetry = grid
    rich, warm = fuel.reshape(-1), temperature.reshape(-1)
    nt, nr = len(polar) - 1, len(radius) - 1
    cell, weight = np.empty(8, dtype=np.int64), np.empty(8)
    p, q = np.empty(3), np.empty(3)
    for i in range(result.shape[1]):
        for j in range(result.shape[2]):
            for k in range(result.shape[3]):
                if without[0, 0] <= i < without[1, 0] and without[0, 1] <= j < without[1, 1]:
                    if without[0, 2] <= k < without[1, 2]:
                        continue
                p[0] = origin[0] + (i + 0.5) * spacing
                p[1] = origin[1] + (j + 0.5) * spacing
                p[2] = origin[2] + (k + 0.5) * spacing
                away = np.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
                if away > radius[nr] + spacing:
                    continue
                if away > 8 * spacing:
                    up = 0.0
                    for a in range(3):
                        up += frame[2, a] * p[a]
                    shell = min(max(np.searchsorted(radius, away) - 1, 0), nr - 1)
                    slack = spacing / away
                    up /= away
                    if up < cosines[0, shell] - slack or up > cosines[1, shell] + slack:
                        continue
                # A voxel near the tip is wider than the plumes there.
                points = 6
                if away > 8 * spacing:
                    points = 2 if away < 30 * spacing else 1
                part = (spacing / points) ** 3
                near = away <= 8 * spacing
                for n in range(-1, points**3):
                    if n < 0:
                        if near or points == 1:
                            continue
                        dx, dy, dz = 0.0, 0.0, 0.0
                    else:
                        dx = ((n // points**2 + 0.5) / points - 0.5) * spacing
                        dy = ((n // points % points + 0.5) / points - 0.5) * spacing
                        dz = ((n % points + 0.5) / points - 0.5) * spacing
                    for a in range(3):
                        q[a] = (
                            frame[a, 0] * (p[0] + dx)
                            + frame[a, 1] * (p[1] + dy)
                            + frame[a, 2] * (p[2] + dz)
                        )
                    flat = np.sqrt(q[0] * q[0] + q[1] * q[1])
                    lean = np.arctan2(flat, q[2])
                    r = np.sqrt(flat * flat + q[2] * q[2])
                    if lean < polar[0] or lean > polar[nt] or r > radius[nr]:
                        continue
                    angle = 0.0
                    if symmetry != 0:
                        angle = np.arctan2(q[1], q[0])
                        if symmetry == 1 and (angle < azimuth[0] or angle > azimuth[-1]):
                            continue
                        angle -= turn_of(symmetry, angle)
                        if symmetry > 1:
                            angle = abs(angle)
                    around, down = between(azimuth, angle), between(polar, lean)
                    along = between(radius, r)
                    corners(around, down, along, nt, nr, cell, weight)
                    mass, heat = 0.0, 0.0
                    for c in range(8):
                        here = weight[c] * rich[cell[c]]
                        mass += here
                        heat += here * warm[cell[c]]
                    if n < 0:
                        if mass < 0.1 * least:
                            break
                        continue
                    if mass < least:
                        continue
                    shell = along[1] if along[2] >= 0.5 else along[0]
                    shells[shell] += mass * part
                    part_here = part * factor[shell]
                    result[0, i, j, k] += mass * part_here
                    result[1, i, j, k] += heat * part_here
