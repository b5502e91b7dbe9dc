"""Vapour of the grid of rays on regular lattices, finer towards the tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats, Ints, Mask
from cldit.constants import AVOGADRO_PER_MOL
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.fixed_point import fixed_point_defines, fixed_point_scale, fixed_point_sums
from cldit.gpu.program import Define, build
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.rays import RayGrid
from cldit.spray.result import Cells, Vapour

NEGLIGIBLE = 1e-6  # mass fraction of vapour below which cells are omitted from the result
SPACING_m = 0.5e-3  # of the lattice, whatever the grid is
_NEAR_m = (10e-3, 4e-3)  # of the tip: half of the spacing in each, three voxels or more in a plume
_FAINT = 0.1  # of NEGLIGIBLE, which is added to voxels
_MOST = 240  # voxels along an axis
_ROUNDS = 30  # of the shells' factors: their content is right to 1e-3 or so


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

    The vapour in each shell of cells is kept, and none is in the tip. Temperatures are means by
    mass of vapour.
    """
    grid, vapour = flow.grid, flow.read("fuel")
    negligible = NEGLIGIBLE * flow.far_density_kg_m3
    if not (vapour >= negligible).any():
        return None
    lattices = lattices_of(grid, vapour >= negligible)
    fillings = Filling(flow, vapour, threshold=_FAINT * negligible).masses(lattices)
    lower, upper, number, warm = [], [], [], []
    for lattice, voxels in zip(lattices, fillings, strict=True):
        mass, temperature = voxels.reshape(-1, 2).T
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
    edge_m = max(SPACING_m, float(np.max(high - low)) / _MOST)
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


class Filling:
    """Kernel that fills lattices with the vapour of a gas (A, P, R), from a density on."""

    def __init__(self, flow: GasFlow, vapour: Floats, *, threshold: float) -> None:
        grid, fields = flow.grid, flow.fields
        self.device, self.shells = flow.device, grid.shape[2]
        self.content = np.sum(vapour * grid.volume_m3, axis=(0, 1)) * grid.copies
        self.densest = float(vapour.max())
        warmth = fields.plane("warmth")
        fields.write(warmth, vapour * flow.read("temperature"))
        self.arguments: dict[str, Any] = {
            "fuel": flow.fuel,
            "warmth": warmth,
            "least_density": float(threshold),
            "cosines": self._single("cosines", _cosines(grid, vapour >= 0.1 * threshold).T),
            **fields.places(),
        }
        defines: dict[str, Define] = {
            "SIMD_WIDTH": 1,
            "GAS_REAL": "double" if fields.real is np.float64 else "float",
            **fixed_point_defines(self.device),
        }
        self.program = build(self.device, "spray/vapour_lattice.cl", defines)

    def _single(self, name: str, values: Floats) -> Any:
        return upload(self.device, name, np.ascontiguousarray(values, np.float32))

    def masses(self, lattices: list[Lattice]) -> list[Floats]:
        """Mass and temperature (X, Y, Z, 2) of the voxels of each lattice."""
        room = sum(float(np.prod(box.shape)) * box.edge_m**3 for box in lattices)
        scale = fixed_point_scale(self.densest * room)
        sums = zeros(self.device, "shells", 3 * self.shells, np.int64)
        factor = np.ones(self.shells)
        for lattice in lattices:
            self.fill(lattice, factor, (sums, scale))
        parts = fixed_point_sums(self.device, sums, 3 * self.shells, scale).reshape(-1, 3)
        for _ in range(_ROUNDS):
            beside = np.pad(factor, 1)
            summed = parts[:, 0] * beside[:-2] + parts[:, 1] * factor + parts[:, 2] * beside[2:]
            factor *= np.divide(self.content, summed, out=np.ones_like(factor), where=summed > 0)
        return [self.fill(lattice, factor) for lattice in lattices]

    def fill(
        self, lattice: Lattice, factor: Floats, shells: tuple[Any, float] | None = None
    ) -> Floats:
        """Mass and temperature (X, Y, Z, 2) of voxels, with a factor (R,) for each shell.

        shells: buffer of three sums for each shell, see vapour_lattice.cl, and their scale.
        """
        sums, scale = shells or (zeros(self.device, "shells", 1, np.int64), 0.0)
        shape, count = lattice.shape.tolist(), int(np.prod(lattice.shape))
        voxels = zeros(self.device, "voxels", 2 * count, np.float32)
        arguments = {
            **self.arguments,
            "factor": self._single("factor", factor),
            "lattice": np.array([*lattice.corner_m, lattice.edge_m], np.float32),
            "shape": np.array([*shape, 0], np.int32),
            "without_from": np.array([*lattice.without[0], 0], np.int32),
            "without_to": np.array([*lattice.without[1], 0], np.int32),
            "scale": scale,
            "shells": sums,
            "voxels": voxels,
        }
        if count:
            self.program.launch("vapour_lattice", tuple(shape[::-1]), (32, 1, 1), arguments)
        return download(self.device, voxels, np.empty((*shape, 2), np.float32)).astype(float)


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
