"""NumPy twin, in double precision, of `limit_gradient` (kernels/components.h) and of image.cl's
records, from the coefficients that are linear in cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Reals
from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.transport.cells import OpticalCells, SweptBox
from cldit.transport.discrete_ordinates.gradients import beside_on_axes
from cldit.transport.linear_coefficients import device_cells

# As |g| is 2 at most, a value of |s| up to 3/2 S has 3/4 S in the middle at least, and falls by 3/4
# S to a corner: to 0, not below.
MOST = 4.0 / 3.0


@dataclass(frozen=True)
class LinearCoefficients:
    """Coefficients of stored cells and coarse leaves, as kernels/linear_coefficients.cl makes them.

    extinction: (P, 3) gradient along x, y, z, per finest cell, relative to its mean.
    albedo, emission: (P, 3) and (E, P, 3) gradients of the scattered share of the extinction, and
    of each emitter's emission over extinction.
    middle_albedo, middle_emission: (P,) and (E, P) values in the middles.
    edge: (P,) edge of the cell or leaf, in finest cells.
    """

    extinction: Reals
    albedo: Reals
    emission: Reals
    middle_albedo: Reals
    middle_emission: Reals
    edge: Reals

    @classmethod
    def of(
        cls, device: Device, cells: OpticalCells, real: type[np.floating] | None = None
    ) -> LinearCoefficients:
        """Those on the device, in its best precision unless `real` is another."""
        real = real or (np.float64 if device.info.float64 else np.float32)
        count, emitters = len(cells.depth), len(cells.needs.emitters)
        shapes = {
            "cell_gradients": (count, 2 + emitters, 3),
            "albedo": (count,),
            "thermal": (emitters, count),
        }
        buffers = device_cells(device, cells, real, linear=True)
        gradients, albedo, emission = (
            download(device, buffers[name], np.empty(shape, real)).astype(float)
            for name, shape in shapes.items()
        )
        tree, edge = cells.tree, np.ones(count)
        edge[-len(tree.coarse_level) :] = tree.frame.cells >> tree.coarse_level
        of_emitters = gradients[:, 2:].transpose(1, 0, 2)
        return cls(gradients[:, 0], gradients[:, 1], of_emitters, albedo, emission, edge)


def spatial_gradients(
    light: Reals,
    cells: OpticalCells,
    box: SweptBox,
    known: tuple[NDArray[np.intp], Reals] | None = None,
) -> Reals:
    """Gradient (3, C, N) of the radiance in each scattering cell along x, y, z, per cell.

    The value at a face is between the means of both cells, closer to that of the thinner one: a
    cell's share of the difference is proportional to the root of its optical depth. It would be the
    depth itself in diffusion, and equal shares in transparent cells; on `gdi` the root has the
    smallest error. A cell with one neighbour has the same slope on both sides. Gradients are
    limited so that no component is negative.

    light: (C, N) mean radiance of the cells. known: cells (M,) and their gradients (3, C, M), which
    take precedence.
    """
    every = np.arange(len(cells.address))
    gradient = np.zeros((3, *light.shape), light.dtype)
    root = np.sqrt(cells.depth[cells.address]).astype(light.dtype)
    beside = beside_on_axes(cells, box, (-1, 1), np.ones(len(every), bool))
    for along, (below, above) in zip(gradient, beside, strict=True):
        sides = np.where((below >= 0) & (above >= 0), 1, 2).astype(light.dtype)
        for there, sign in ((below, -1), (above, 1)):
            near = np.where(there >= 0, there, every)
            share = sign * sides * root / (root + root[near])
            along += share * (np.take(light, near, axis=1) - light)
    if known is not None:
        gradient[:, :, known[0]] = known[1]
    limit(gradient, light, cells.needs.boundaries)
    return gradient


@dataclass(frozen=True)
class RecordsTwin:
    """The non-empty cells; those that scatter come first.

    at: (F,) addresses. number: (P,) int32 row of each stored cell, -1 if it is empty.
    linear: coefficients that are linear in cells; None: they are constant.
    """

    cells: OpticalCells
    at: Ints
    number: NDArray[np.int32]
    linear: LinearCoefficients | None = None

    @classmethod
    def of(cls, cells: OpticalCells, linear: LinearCoefficients | None = None) -> RecordsTwin:
        """Records of all stored cells of optical depth above 0; `linear` as in the class."""
        others = cells.depth > 0
        others[cells.address] = False
        at = np.concatenate([cells.address, np.flatnonzero(others)])
        number = np.full(len(cells.depth), -1, np.int32)
        number[at] = np.arange(len(at))
        return cls(cells, at, number, linear)

    def linear_sources(
        self,
        listed: list[Reals | None],
        gradient: Reals | None,
        thick: Ints | None,
    ) -> tuple[list[Reals | None], Reals]:
        """Sources in the middles of cells and their gradients, where coefficients are linear.

        Args:
            listed, thick: as in `records`; either all sources are None or none is.
            gradient: (3, C, N) of the scattered part of the sources; None: it is constant.

        Returns:
            Sources (C, N) for `records`, and (F, 3 S) gradients of the S components that cells
            emit. In thick cells the emission has its own gradient, and the first boundary's place
            has the albedo's, which shifts light between the emission and the gather.
        """
        cells, needs, linear = self.cells, self.cells.needs, self.linear
        assert linear is not None
        first = 0 if needs.scattering else needs.boundaries
        out = [None if source is None else np.array(source) for source in listed]
        sources = [source for source in out if source is not None]
        count = len(cells.address) if sources else 0
        table = np.zeros((len(self.at), 3, len(needs.components) - first), np.float32)
        for begin in range(0, len(self.at), 2**18):
            some = slice(begin, min(begin + 2**18, len(self.at)))
            at = self.at[some]
            change = np.zeros((3, len(needs.components), len(at)), np.float32)
            change[:, needs.boundaries :] = linear.emission[:, at].transpose(2, 0, 1)
            known, mine = slice(begin, min(some.stop, count)), slice(0, max(count - begin, 0))
            if mine.stop:
                mean = np.mean([source[:, known] for source in sources], axis=0)
                light = mean.copy()
                light[needs.boundaries :] -= cells.thermal_planes(np.float32, at[mine])
                light /= cells.albedo[known].astype(np.float32)
                own = change[:, :, mine] + light * linear.albedo[at[mine]].T[:, None]
                if gradient is not None:
                    own += gradient[:, :, known]
                edge = linear.edge[at[mine]]
                own *= edge
                limit(own, mean / np.float32(MOST), needs.boundaries)
                excess = np.einsum("pi,icp->cp", linear.extinction[at[mine]], own) * edge
                for source in sources:
                    source[:, known] -= excess / np.float32(12)
                change[:, :, mine] = own / edge
            table[some] = change[:, first:].transpose(2, 0, 1)
        if thick is not None:
            at = cells.address[thick]
            table[thick] = 0.0
            table[thick, :, 0] = linear.albedo[at]
            table[thick, :, needs.boundaries :] = linear.emission[:, at].transpose(1, 2, 0)
        return out, table.reshape(len(self.at), 3 * table.shape[2])

    def records(
        self,
        listed: list[Reals | None],
        defect: Floats,
        thick: Ints | None,
        real: type[np.floating],
    ) -> Reals:
        """Records (F, R) of the cells, in the type `real`.

        A record contains the optical depth of the cell's edge; its relative gradient if linear;
        with `thick`, the albedo of thick cells, else 0; and for each image the source of all
        components and the emission at radiance 1. If nothing scatters, it contains emitters only,
        and the emission at radiance 1 is 1.

        Args:
            listed, defect: as in `FormalSolution.images`.
            thick: (T,) the scattering cells that the final gather refines; None: no gather.
            real: the device's precision.
        """
        cells, needs = self.cells, self.cells.needs
        thermal: Reals = cells.thermal_planes(real, self.at).T
        albedo: Reals = cells.albedo
        head = cells.depth[self.at, None].astype(real)
        if self.linear is not None:
            thermal = self.linear.middle_emission[:, self.at].T.astype(real)
            albedo = self.linear.middle_albedo[cells.address]
            head = np.column_stack([head, self.linear.extinction[self.at]]).astype(real)
        if not needs.scattering:
            return np.column_stack([head, thermal])
        albedo_at = head.shape[1]
        first = albedo_at if thick is None else albedo_at + 1
        parts = len(needs.components) + 1
        out = np.zeros((len(self.at), first + parts * len(listed)), real)
        out[:, :albedo_at] = head
        row = self.number[cells.address]
        if thick is not None:
            out[row[thick], albedo_at] = albedo[thick]
        for image, source in enumerate(listed):
            mine = out[:, first + parts * image : first + parts * (image + 1)]
            mine[:, needs.boundaries : -1] = thermal
            mine[:, -1] = 1.0
            if source is None:
                continue
            made = cells.albedo * defect
            value = np.empty((len(row), parts), real)
            value[:, :-1] = source.T
            outside = source[: needs.boundaries].sum(axis=0, dtype=np.float64)
            value[:, -1] = 1.0 - outside + made
            if thick is not None:
                # The gather adds the scattered light.
                value[thick, :-1] = 0.0
                value[thick, -1] = (1.0 - albedo + made)[thick]
                value[thick, needs.boundaries : -1] = thermal[row[thick]]
            mine[row] = value
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
