"""Vapour of the grid of rays on regular lattices, finer towards the tip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats, Ints, Mask
from cldit.constants import AVOGADRO_PER_MOL
from cldit.gpu.buffers import download, zeros
from cldit.gpu.program import Define, build
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.rays import RayGrid
from cldit.spray.result import Cells, Vapour

NEGLIGIBLE = 1e-6  # mass fraction of vapour below which cells are omitted from the result
SPACING_m = 0.5e-3  # of the lattice, whatever the grid is
_NEAR_m = (10e-3, 4e-3)  # of the tip: half of the spacing in each, three voxels or more in a plume
_FAINT = 0.1  # of NEGLIGIBLE, which is added to voxels


@dataclass(frozen=True)
class Lattice:
    """Regular lattice of voxels.

    corner_m: (3,). shape: (3,) voxels. without: (2, 3) first voxel, and the one after the last, of
    a box with a lattice of its own.
    """

    corner_m: Floats
    edge_m: float
    shape: Ints
    without: Ints


def sampled(flow: GasFlow, fuel: Fuel) -> Vapour | None:
    """Vapour on lattices, linear between the middles of the cells of rays.

    All vapour is kept, that of each shell but for the voxels across its faces, and none is in the
    tip. Temperatures are means by mass of vapour.
    """
    grid, vapour = flow.grid, flow.read("fuel")
    negligible = NEGLIGIBLE * flow.far_density_kg_m3
    if not (vapour >= negligible).any():
        return None
    lattices = lattices_of(grid, vapour >= negligible)
    factor = shell_factors(grid, vapour)
    fillings = filled(flow, vapour, lattices, factor, threshold=_FAINT * negligible)
    # Sums over voxels are not the integral, by some 1e-3.
    exact = flow.fuel_kg / sum(float(voxels[..., 0].sum()) for voxels in fillings)
    lower, upper, number, warm = [], [], [], []
    for lattice, voxels in zip(lattices, fillings, strict=True):
        mass, temperature = voxels.reshape(-1, 2).T
        mass = mass * exact
        index = np.flatnonzero(mass > negligible * lattice.edge_m**3)
        steps = np.stack(np.unravel_index(index, tuple(lattice.shape)), axis=1)
        lower.append(lattice.corner_m + steps * lattice.edge_m)
        upper.append(lattice.corner_m + (steps + 1) * lattice.edge_m)
        number.append(mass[index] / lattice.edge_m**3 * (AVOGADRO_PER_MOL / fuel.molar_mass_kg_mol))
        warm.append(temperature[index])
    return Vapour(
        cells=Cells(np.concatenate(lower), np.concatenate(upper)),
        number_density_m3=np.concatenate(number),
        temperature_K=np.concatenate(warm),
        molar_mass_kg_mol=fuel.molar_mass_kg_mol,
    )


def lattices_of(grid: RayGrid, rich: Mask) -> list[Lattice]:
    """Lattice around the cells that are rich (A, P, R), and one in the place of its voxels near
    the tip, of half the spacing, in which there may be another one."""
    low, high = _bounds(grid, rich)
    # At most 240 voxels along an axis.
    edge_m = max(SPACING_m, float(np.max(high - low)) / 240)
    corner = edge_m * (np.floor(low / edge_m) - 1)
    shape = np.ceil((high - corner) / edge_m).astype(np.int64) + 2
    lattices = []
    for near_m in (*_NEAR_m, 0.0):
        box = np.rint((np.array([[-near_m], [near_m]]) - corner) / edge_m)
        without = np.clip(box, 0, shape).astype(np.int64)
        lattices.append(Lattice(corner, edge_m, shape, without))
        corner = corner + without[0] * edge_m
        shape, edge_m = 2 * (without[1] - without[0]), 0.5 * edge_m
    return lattices


def shell_factors(grid: RayGrid, vapour: Floats) -> Floats:
    """Factors (R,) of interpolated vapour (A, P, R), which keep the content of each shell.

    They are linear between shells. The integral over a shell is exact: with sums over points of a
    lattice, factors would be errors of its quadrature, and seen as rings across a jet.
    """
    azimuth, polar, radius = (
        _HalfCells(faces) for faces in (grid.azimuth, grid.polar, grid.radius_m)
    )
    azimuthal = np.diff(grid.azimuth) if grid.ring else azimuth.integrals(np.ones_like)
    angles = azimuthal[:, None] * polar.integrals(np.sin) * grid.copies
    along = np.tensordot(angles, vapour, 2)
    low, high, part = radius.low, radius.high, radius.part
    shell = radius.weight * radius.place**2 * ((1 - part) * along[low] + part * along[high])
    content = np.sum(vapour * grid.volume_m3, axis=(0, 1)) * grid.copies
    factor = np.ones(len(along))
    # The shells' content is then right to 1e-3 or so.
    for _ in range(30):
        amount = shell * ((1 - part) * factor[low] + part * factor[high])
        summed = np.bincount(radius.cell, amount, len(along))
        factor *= np.divide(content, summed, out=np.ones_like(factor), where=summed > 0)
    return factor


class _HalfCells:
    """Gauss points of the halves of cells, in which fields are linear: 4, exact to the 7th power.

    place, weight (N,); cell: that of each point; low, high, part: cells whose middles are beside
    it, and the weight of the higher one, as in ray_place.h.
    """

    def __init__(self, faces: Floats) -> None:
        count = len(faces) - 1
        nodes, weights = np.polynomial.legendre.leggauss(4)
        inside = np.arange(count * 2)[:, None] / 2 + (nodes + 1) / 4  # in cells
        self.cell = inside.astype(np.int64).reshape(-1)
        width = np.diff(faces)[self.cell]
        self.place = faces[self.cell] + width * (inside.reshape(-1) - self.cell)
        self.weight = width * np.tile(weights / 4, 2 * count)
        at = np.clip(inside.reshape(-1) - 0.5, 0, count - 1)
        self.low = np.minimum(at.astype(np.int64), max(count - 2, 0))
        self.high, self.part = np.minimum(self.low + 1, count - 1), at - self.low

    def integrals(self, measure: Callable[[Floats], Floats]) -> Floats:
        """Integrals of the interpolation of each cell's value, by a measure of the place."""
        amount = self.weight * measure(self.place)
        count = int(self.cell[-1]) + 1
        below, above = amount * (1 - self.part), amount * self.part
        sums = np.bincount(self.low, below, count) + np.bincount(self.high, above, count)
        return np.asarray(sums, np.float64)


def filled(
    flow: GasFlow, vapour: Floats, lattices: list[Lattice], factor: Floats, *, threshold: float
) -> list[Floats]:
    """Mass and temperature (X, Y, Z, 2) of the voxels of each lattice.

    vapour: (A, P, R) density, which counts from the threshold on; factor: (R,) of each shell.
    """
    grid, fields, device = flow.grid, flow.fields, flow.device
    warmth = fields.plane("warmth")
    fields.write(warmth, vapour * flow.read("temperature"))
    cosines = _cosines(grid, vapour >= 0.1 * threshold).T
    shared: dict[str, Any] = {
        "fuel": flow.fuel,
        "warmth": warmth,
        "least_density": float(threshold),
        "cosines": fields.table("cosines", cosines, np.float32),
        "factor": fields.table("factor", factor, np.float32),
        **fields.places(),
    }
    defines: dict[str, Define] = {
        "SIMD_WIDTH": 1,
        "GAS_REAL": "double" if fields.real is np.float64 else "float",
    }
    program = build(device, "spray/vapour_lattice.cl", defines)
    fillings = []
    for lattice in lattices:
        shape, count = lattice.shape.tolist(), int(np.prod(lattice.shape))
        voxels = zeros(device, "voxels", 2 * count, np.float32)
        arguments = {
            **shared,
            "lattice": np.array([*lattice.corner_m, lattice.edge_m], np.float32),
            "shape": np.array([*shape, 0], np.int32),
            "without_from": np.array([*lattice.without[0], 0], np.int32),
            "without_to": np.array([*lattice.without[1], 0], np.int32),
            "voxels": voxels,
        }
        if count:
            program.launch("vapour_lattice", tuple(shape[::-1]), (32, 1, 1), arguments)
        fillings.append(download(device, voxels, np.empty((*shape, 2), np.float32)).astype(float))
    return fillings


def _cosines(grid: RayGrid, rich: Mask) -> Floats:
    """Least and largest cosine of the polar angle (2, R) at which a shell, or one beside it, has
    rich cells (A, P, R), with a cell more on both sides."""
    any_ = np.asarray(rich.any(axis=0))
    any_[:, 1:] |= any_[:, :-1].copy()
    any_[:, :-1] |= any_[:, 1:].copy()
    count = len(any_)
    begin, end = any_.argmax(axis=0), count - 1 - any_[::-1].argmax(axis=0)
    present = any_.any(axis=0)
    low = np.cos(grid.polar[np.minimum(end + 2, count)])
    high = np.cos(grid.polar[np.maximum(begin - 1, 0)])
    return np.stack([np.where(present, low, 2.0), np.where(present, high, -2.0)])


def _bounds(grid: RayGrid, rich: Mask) -> tuple[Floats, Floats]:
    """Corners of a box around the cells that are rich (A, P, R), those beside them, in which the
    vapour falls to nothing, and their copies."""
    for axis in range(3):
        lowest, highest = (np.take(rich, at, axis) for at in ([0], [-1]))
        below = np.concatenate([lowest, np.delete(rich, -1, axis)], axis)
        rich = rich | below | np.concatenate([np.delete(rich, 0, axis), highest], axis)
    reach_m = np.where(rich, grid.radius_m[1:], 0.0).max(axis=2)
    rays = grid.directions @ grid.frame.T * reach_m[:, :, None]
    rays = rays[reach_m > 0]
    if grid.symmetry != 1:
        wide = np.hypot(rays[:, 0], rays[:, 1])
        turn = np.linspace(0.0, 2 * np.pi, 65)
        ends = zip(wide, rays[:, 2], strict=True)
        ring = np.stack([np.cos(turn), np.sin(turn)])
        rays = np.concatenate([np.stack([*(w * ring), np.full(65, h)], axis=1) for w, h in ends])
    world = rays @ grid.frame
    return np.minimum(world.min(axis=0), 0.0), np.maximum(world.max(axis=0), 0.0)
