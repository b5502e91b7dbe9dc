"""Light of larger cells than those of the image.

The image's error by its cells is nearly all on the lines of sight: a ray crosses one place of a
cell, and not its mean. The radiance that a cell scatters to the camera is an integral over all
directions, in which that error averages out. So the sweeps solve for it on larger cells, and the
image adds it up along rays through smaller ones (docs/transport/method.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Reals
from cldit.errors import TransportError
from cldit.medium.coarsened import coarsened
from cldit.transport.camera_source import CameraSource
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gradients import beside_on_axes
from cldit.transport.result import TraceInput
from cldit.transport.thick_region import ThickRegion


@dataclass(frozen=True)
class CoarseLight:
    """The medium on the cells of the light, and on those of the image.

    swept, image: `image` has the unit of the light's thermal sources. fold: edge of the light's
    cells over that of the image's. parent: (N,) scattering cell of the light around each of the
    image's; None: the cells are the same.
    """

    swept: TraceInput
    image: TraceInput
    fold: int = 1
    parent: Ints | None = None

    @classmethod
    def of(cls, given: TraceInput) -> CoarseLight:
        """Cells larger by `settings.light` doublings, or by fewer: none may reach behind the
        background or a patch."""
        halvings, tree = given.settings.light, given.cells.tree
        while halvings > 0:
            large = coarsened(tree, halvings)
            light = TraceInput.of(large, given.scene, given.device, given.settings)
            try:
                light.check_boundary()
            except TransportError:
                halvings -= 1
                continue
            if large is tree:
                break
            cells = given.cells.in_units_of(light.cells)
            fold = 1 << (tree.frame.depth - large.frame.depth)
            number = np.full(len(light.cells.depth), -1)
            number[light.cells.address] = np.arange(len(light.cells.address))
            address = light.cells.stored(cells.positions(cells.address) // fold)
            return cls(light, replace(given, cells=cells), fold, number[address])
        given.check_boundary()
        return cls(given, given)

    def thick(self, region: ThickRegion | None) -> Ints | None:
        """Scattering cells (T,) of the image within the thick ones of the light."""
        if region is None or self.parent is None:
            return None if region is None else region.listed
        is_thick = np.zeros(len(self.swept.cells.address), bool)
        is_thick[region.listed] = True
        return np.flatnonzero(is_thick[self.parent])

    def onto_image(self, camera: CameraSource) -> CameraSource:
        """The sources of the image's cells, by radiance that is linear in the light's."""
        if self.parent is None:
            return camera
        coarse, cells, parent = self.swept.cells, self.image.cells, self.parent
        real = self.swept.settings.real
        thermal = coarse.thermal_source()
        halves = [(half - thermal) / coarse.albedo for half in camera.halves]
        gradient = _gradient(coarse, (halves[0] + halves[1]) / 2)
        if camera.known is not None:
            gradient[:, :, camera.known[0]] = camera.known[1]
        limit(gradient, (halves[0] + halves[1]) / 2, coarse.needs.boundaries)
        inside = cells.positions(cells.address) % self.fold
        off = ((inside + 0.5) / self.fold - 0.5).T
        own = cells.thermal_source()
        made = [np.empty(own.shape, real) for _ in halves]
        for c in range(len(own)):
            change = sum(off[axis] * gradient[axis, c, parent] for axis in range(3))
            for out, half in zip(made, halves, strict=True):
                out[c] = own[c] + cells.albedo * (half[c, parent] + change)
        defect = camera.defect[parent]
        return replace(camera, halves=(made[0], made[1]), known=None, defect=defect)


def _gradient(cells: OpticalCells, radiance: Reals) -> Floats:
    """Gradient (3, C, N) of a radiance (C, N), per cell, from the neighbours as in image.cl."""
    root = np.sqrt(cells.depth[cells.address])
    out = np.zeros((3, *radiance.shape))
    chosen = np.ones(len(root), bool)
    for axis, (below, above) in enumerate(beside_on_axes(cells, cells.box(), (-1, 1), chosen)):
        for near, far, sign in ((below, above, -1.0), (above, below, 1.0)):
            share = np.where(far < 0, 2.0, 1.0) * root / (root + root[near])
            share = np.where(near >= 0, sign * share, 0.0)
            out[axis] += share * (radiance[:, near] - radiance)
    return out


def limit(gradient: NDArray[np.floating], light: NDArray[np.floating], boundaries: int) -> None:
    """Limits gradients (3, C, N) in place, so that no component is negative anywhere in a cell.

    The means of the cells (C, N), `light`, are conserved, as by the slope limiters of finite
    volumes (van Leer, J. Comput. Phys. 32, 1979). The excess of a component goes to the others of
    its group, the first `boundaries` ones from outside or those that the medium emits, by their
    shares of the light. So the sums of both groups keep their gradients, which are opposite in an
    isothermal cavity. If the others cannot take it, all gradients of the cell shrink by one factor.
    """
    mean = np.maximum(light, 0)
    for group in (slice(boundaries), slice(boundaries, None)):
        total = mean[group].sum(axis=0)
        gradient *= _allowed(np.abs(gradient[:, group].sum(axis=1)).sum(axis=0), total)
    for group in (slice(boundaries), slice(boundaries, None)):
        part, own = mean[group], gradient[:, group]
        total, change = part.sum(axis=0), own.sum(axis=1)
        own *= _allowed(np.abs(own).sum(axis=0), part)
        share = np.divide(part, total, out=np.zeros_like(part), where=total > 0)
        own += (change - own.sum(axis=1))[:, None] * share
    if len(mean):
        gradient *= _allowed(np.abs(gradient).sum(axis=0), mean).min(axis=0)


def _allowed(steepness: NDArray[np.floating], mean: NDArray[np.floating]) -> NDArray[np.floating]:
    """Factors up to 1 with which sums of |gradient| along the axes are at most twice the mean."""
    most = 2 * mean
    return np.asarray(np.divide(most, steepness, out=np.ones_like(most), where=steepness > most))
