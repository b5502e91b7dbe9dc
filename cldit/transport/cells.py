"""The octree's coefficients as the kernels read them: optical depths, sources, albedos.

All methods and all stages of `trace_source` take their medium from here.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.medium.frame import BRICK, CELLS_PER_BRICK
from cldit.medium.octree import Octree
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.scene.schema import Scene

_FAINTEST = 1e-3  # of the hottest black body: smallest unit of thermal sources
# Places in the cube have 24 bits. Their rounding is at most 2^-7 of a mean free path: at 2^-3 of
# one T_app of an even cube was 0.3 K too large, at 2^-7 0.04 K.
DEEPEST = 2.0**17  # optical depth of a cell, times the number of cells along the cube


@dataclass(frozen=True)
class Needs:
    """Physics that a scene needs; kernels are compiled for it alone."""

    vapour: bool
    droplets: bool
    scattering: bool
    patches: tuple[str, ...] = ()  # named parts of the enclosure, beside background and wall

    @property
    def boundaries(self) -> int:
        """Number of components that enter from outside; those that the medium emits follow."""
        return 2 + len(self.patches)

    @property
    def emitters(self) -> tuple[str, ...]:
        """Names of the components that the medium emits."""
        present = {"vapour": self.vapour, "liquid": self.droplets}
        return tuple(name for name, exists in present.items() if exists)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of all components, in the kernels' order (kernels/components.h)."""
        return ("background", "wall", *self.patches, *self.emitters)

    @property
    def defines(self) -> dict[str, int]:
        """Compile-time defines of the kernels."""
        counts = {
            "N_PATCHES": len(self.patches),
            "EMITTERS": len(self.emitters),
            "HAS_SCATTERING": int(self.scattering),
        }
        return {name: count for name, count in counts.items() if count}


@dataclass(frozen=True)
class SweptBox:
    """Box of finest cells that is swept: low..low + shape, both (x, y, z)."""

    low: tuple[int, int, int]
    shape: tuple[int, int, int]

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))


@dataclass(frozen=True)
class OpticalCells:
    """Stored cells and coarse leaves, in the octree's addresses.

    depth: (P,) optical depth of a finest cell's edge, at most that of which single precision
        resolves the mean free path. Such cells are opaque, and have the radiance of deeper ones.
    emitted: (P,) thermal part of the source function for each of `needs.emitters`, over `scale`.
    scale: unit of `emitted`, photons s-1 m-2 sr-1: the largest thermal source, and at least a
        thousandth of the hottest phase's black-body radiance. Weak emission adds up to that over
        many scatterings, and single precision resolves no more.
    address: (N,) the scattering cells.
    albedo, coalbedo: (N,) scattered and absorbed share of the extinction. Both are stored, because
        a small 1 - albedo would be lost to rounding.
    """

    tree: Octree
    needs: Needs
    scale: float
    depth: NDArray[np.float64]
    emitted: dict[str, NDArray[np.float64]]
    address: NDArray[np.int64]
    albedo: NDArray[np.float64]
    coalbedo: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        tree: Octree,
        *,
        patches: tuple[str, ...] = (),
        scattered: float | NDArray[np.float64] = 1.0,
    ) -> "OpticalCells":
        """Coefficients of a tree, in double precision.

        scattered: share of the scattering that counts, of all cells or (P,); 1 - g is the transport
        correction.
        """
        fields = tree.fields
        absorption = fields["vapour_absorption"].astype(np.float64)
        absorption += fields["droplet_absorption"]
        scattering = fields["droplet_scattering"].astype(np.float64) * scattered
        extinction = absorption + scattering
        safe = np.where(extinction > 0, extinction, 1.0)
        emitted = {
            "vapour": fields["vapour_emission"] / safe,
            "liquid": fields["droplet_emission"] / safe,
        }
        hottest = float(_black(fields).max(initial=0.0))
        largest = max(float(values.max(initial=0.0)) for values in emitted.values())
        scale = max(largest, _FAINTEST * hottest) or 1.0
        for values in emitted.values():
            values /= scale
        address = np.flatnonzero(scattering > 0)
        needs = Needs(
            vapour=tree.has_vapour,
            droplets=tree.has_droplets,
            scattering=len(address) > 0,
            patches=patches,
        )
        return cls(
            tree=tree,
            needs=needs,
            scale=scale,
            depth=np.minimum(extinction * tree.frame.cell_m, DEEPEST / tree.frame.cells),
            emitted=emitted,
            address=address,
            albedo=scattering[address] / safe[address],
            coalbedo=absorption[address] / safe[address],
        )

    def cutoff(self, scene: Scene, *, tolerance_K: float) -> float:
        """Transmission below which the light beyond changes T_app by at most `tolerance_K`."""
        return self.temperature(scene).cutoff(_black(self.tree.fields), tolerance_K=tolerance_K)

    @property
    def hottest(self) -> float:
        """Largest black-body radiance of the medium, photons s-1 m-2 sr-1."""
        return float(_black(self.tree.fields).max(initial=0.0))

    def temperature(self, scene: Scene, *, visible: float = VISIBLE_EMISSIVITY) -> TraceTemperature:
        """T_app of weights that are traced through these cells; `visible` as there."""
        return TraceTemperature.of(scene, [self.scale] * len(self.needs.emitters), visible)

    @cached_property
    def on_device(self) -> dict[Any, dict[str, Any]]:
        """Arrays of the medium on devices, see linear_coefficients.py."""
        return {}

    def in_units_of(self, reference: "OpticalCells") -> "OpticalCells":
        """Same cells, with thermal sources in the other's unit."""
        ratio = self.scale / reference.scale
        emitted = {name: values * ratio for name, values in self.emitted.items()}
        return replace(self, scale=reference.scale, emitted=emitted)

    def thermal_source(self) -> NDArray[np.float64]:
        """Thermal source (C, N) of the scattering cells."""
        outside = np.zeros((self.needs.boundaries, len(self.address)))
        return np.concatenate([outside, self.thermal_planes(np.float64, self.address)])

    def thermal_planes(
        self, real: type[np.floating], at: NDArray[np.int64] | slice = slice(None)
    ) -> NDArray[np.floating]:
        """Thermal source (E, P) of `needs.emitters`, in the type `real`, at the addresses `at`."""
        planes = [self.emitted[name][at].astype(real) for name in self.needs.emitters]
        return np.stack(planes) if planes else np.zeros((0, len(self.depth[at])), real)

    def bounds(self) -> SweptBox:
        """Smallest box around all non-empty space; its lower corner is a brick's."""
        return self._around(self.tree.filled)

    def box(self) -> SweptBox:
        """Swept box: the smallest around all divided bricks. Its lower corner is a brick's.

        Undivided leaves outside it are thinner than the octree's bound; only the image uses them.
        """
        return self._around(self.tree.directory >= 0)

    def _around(self, bricks: NDArray[np.bool_]) -> SweptBox:
        if not bricks.any():
            return SweptBox(low=(0, 0, 0), shape=(1, 1, 1))
        low, shape = [], []
        for axis, two_axes in enumerate(((0, 1), (0, 2), (1, 2))):  # the remaining axis: x, y, z
            along = np.flatnonzero(bricks.any(axis=two_axes))
            low.append(int(along[0]) * BRICK)
            low_brick, high_brick = int(along[0]), int(along[-1])
            # Cut at neither side or at both: a box that is mirrored about its content stays so.
            begins = self._occupied(bricks, low_brick, axis)[0] == 0
            end = self._occupied(bricks, high_brick, axis)[-1] + 1 if begins else BRICK
            high = min(high_brick * BRICK + int(end), self.tree.frame.cells)
            shape.append(high - low[-1])
        return SweptBox(low=(low[0], low[1], low[2]), shape=(shape[0], shape[1], shape[2]))

    def _occupied(self, bricks: NDArray[np.bool_], number: int, axis: int) -> NDArray[np.int64]:
        """Cells along x, y or z that are not empty in layer `number` of `bricks`; all if none is.

        A grid whose edge is no multiple of a brick's ends with its cells, so that a background or a
        patch may be directly behind it.
        """
        layer = (slice(None),) * (2 - axis) + (number,)
        slots = self.tree.directory[layer][bricks[layer]]
        stored = self.depth[: self.tree.slots * CELLS_PER_BRICK].reshape(-1, BRICK, BRICK, BRICK)
        occupied = np.zeros(0, np.int64)
        if not np.any(slots < 0):
            layer_axes = tuple({1, 2, 3} - {3 - axis})
            occupied = np.flatnonzero((stored[slots] > 0).any(axis=(0, *layer_axes)))
        return occupied if len(occupied) else np.arange(BRICK)

    def positions(self, address: NDArray[np.int64]) -> NDArray[np.int64]:
        """Finest cell (N, 3; x, y, z) of stored addresses."""
        slot, local = np.divmod(address, CELLS_PER_BRICK)
        z, y, x = np.nonzero(self.tree.directory >= 0)
        order = np.argsort(self.tree.directory[z, y, x])
        corner = np.stack([x, y, z], axis=1)[order] * BRICK
        inside = np.stack([local % BRICK, local // BRICK % BRICK, local // BRICK**2], axis=1)
        return np.asarray(corner[slot] + inside)

    def stored(self, position: NDArray[np.int64]) -> NDArray[np.int64]:
        """Address of finest cells (N, 3; x, y, z); -1 in coarse leaves."""
        brick, local = np.divmod(position, BRICK)
        slot = self.tree.directory[tuple(brick.T[::-1])].astype(np.int64)
        x, y, z = local.T
        return np.where(slot >= 0, slot * CELLS_PER_BRICK + (z * BRICK + y) * BRICK + x, -1)

    def dense(self, box: SweptBox, values: NDArray[Any]) -> NDArray[Any]:
        """Values (P,) of stored cells as a dense array [z, y, x] of `box`; 0 in coarse leaves."""
        z, y, x = np.nonzero(self.tree.directory >= 0)
        slot = self.tree.directory[z, y, x]
        bx, by, bz = (low // BRICK for low in box.low)
        count = [-(-edge // BRICK) for edge in box.shape[::-1]]
        bricks = np.zeros((*count, BRICK, BRICK, BRICK), values.dtype)
        stored = values[: self.tree.slots * CELLS_PER_BRICK].reshape(-1, BRICK, BRICK, BRICK)
        bricks[z - bz, y - by, x - bx] = stored[slot]
        padded = bricks.transpose(0, 3, 1, 4, 2, 5).reshape([n * BRICK for n in count])
        nx, ny, nz = box.shape
        return padded[:nz, :ny, :nx]

    def place(self, box: SweptBox, address: NDArray[np.int64]) -> NDArray[np.int64]:
        """Places (N,) of stored cells, by address (N,), in the flat [z, y, x] order of `box`."""
        x, y, z = (self.positions(address) - np.asarray(box.low)).T
        return np.asarray((z * box.shape[1] + y) * box.shape[0] + x)


def _black(fields: dict[str, NDArray[np.float32]]) -> Floats:
    """Black-body radiances (N,) of what absorbs, by Kirchhoff: emission over absorption."""
    out = []
    for phase in ("vapour", "droplet"):
        absorption = fields[f"{phase}_absorption"]
        absorbs = absorption > 0
        out.append(fields[f"{phase}_emission"][absorbs].astype(np.float64) / absorption[absorbs])
    return np.concatenate(out)


def numbered(listed: NDArray[np.integer], count: int) -> NDArray[np.int32]:
    """Places (count,) of numbers among the `listed` ones (N,); -1: it is not listed."""
    out = np.full(count, -1, np.int32)
    out[listed] = np.arange(len(listed))
    return out


def mean_transmission(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of exp(-t') along optical depths t of any shape: (1 - exp(-t)) / t, and 1 at t = 0."""
    safe = np.where(depth > 0, depth, 1.0)
    return np.where(depth > 0, -np.expm1(-safe) / safe, 1.0)
