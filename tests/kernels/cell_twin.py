"""NumPy twin, in double precision, of kernels/linear_coefficients.cl, of `limit_gradient`
(kernels/components.h), and of image.cl's records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Reals
from cldit.medium.frame import BRICK
from cldit.medium.limiter import limited
from cldit.medium.octree import Octree
from cldit.transport.cells import OpticalCells, SweptBox
from cldit.transport.discrete_ordinates.gradients import beside_on_axes
from cldit.transport.linear_coefficients import _coarse, _positive

# As |g| is 2 at most, a value of |s| up to 3/2 S has 3/4 S in the middle at least, and falls by 3/4
# S to a corner: to 0, not below.
MOST = 4.0 / 3.0
_EXTINCTION = ("vapour_absorption", "droplet_absorption", "droplet_scattering")
_MEAN = 1.0 / 12.0  # of x^2 in a cell of edge 1
_TOGETHER = 2**18  # cells, for memory
_CELLS = BRICK**3


@dataclass(frozen=True)
class LinearCoefficients:
    """Gradients (P, 3) along x, y, z, per finest cell, of stored cells and coarse leaves.

    extinction: relative to its mean.
    albedo: gradient of the scattered share of the extinction.
    emission: (E, P, 3) gradient of each emitter's emission over extinction.
    edge: (P,) edge of the cell or leaf, in finest cells.
    """

    extinction: Reals
    albedo: Reals
    emission: Reals
    edge: Reals

    @classmethod
    def of(cls, tree: Octree, albedo: Reals, emitted: Mapping[str, Reals]) -> LinearCoefficients:
        """Gradients of a tree with the albedo (P,) and emission over extinction (P,) by emitter."""
        fields = tree.fields
        whole = np.sum([fields[name] for name in _EXTINCTION], axis=0)
        safe = np.where(whole > 0, whole, np.float32(1))[:, None]
        gradients = {name: relative_gradient(tree, fields[name]) for name in _EXTINCTION}
        extinction = np.zeros((len(whole), 3), np.float32)
        for name, gradient in gradients.items():
            extinction += fields[name][:, None] / safe * gradient
        edge = np.ones(len(whole), np.float32)
        edge[-len(tree.coarse_level) :] = tree.frame.cells >> tree.coarse_level
        change = np.zeros((3, 1 + len(emitted), len(whole)), np.float32)
        mean = np.stack([albedo, *emitted.values()]).astype(np.float32)
        change[:, 0] = mean[0] * (gradients["droplet_scattering"] - extinction).T
        for number, name in enumerate(emitted, 1):
            field = fields["vapour_emission" if name == "vapour" else "droplet_emission"]
            change[:, number] = mean[number] * (relative_gradient(tree, field) - extinction).T
        for first in range(0, len(whole), _TOGETHER):
            some = slice(first, first + _TOGETHER)
            part = change[:, :, some] * edge[some]
            # The albedo stays within 0..1. All gradients of a cell shrink by one factor, so that
            # they still sum to 0 in an isothermal cavity.
            reach = np.abs(part[:, 0]).sum(axis=0) * np.float32(MOST / 2)
            room = (1 - mean[0, some]) / np.maximum(reach, np.float32(1e-20))
            part *= np.clip(room, 0, 1)
            limit(part, mean[:, some] / np.float32(MOST), 1)
            change[:, :, some] = part / edge[some]
        return cls(extinction, change[:, 0].T, change[:, 1:].transpose(1, 2, 0), edge)

    def excess(self, gradient: Reals) -> Reals:
        """Extinction-weighted mean less the middle value (P,), of gradients (P, 3)."""
        product = np.einsum("pi,pi->p", self.extinction, gradient)
        return np.asarray(product * self.edge**2 * np.float32(_MEAN))


def relative_gradient(tree: Octree, depth: Reals) -> NDArray[np.float32]:
    """Relative gradient (P, 3) along x, y, z, per finest cell, of a coefficient (P,) >= 0.

    It is 0 in empty cells and in coarse leaves that fill the cube.
    """
    out = np.zeros((len(depth), 3), np.float32)
    if not depth.any():
        return out
    fine = tree.slots * _CELLS
    if tree.slots:
        out[:fine] = _positive(depth[:fine], _stored(tree, depth)).T
    out[fine:] = _coarse(tree, depth)
    return out


def _stored(tree: Octree, depth: Reals) -> Reals:
    """Limited slopes (3, N) of stored cells, per edge."""
    values = depth[: tree.slots * _CELLS].reshape(-1, BRICK, BRICK, BRICK)
    at = np.empty((tree.slots, 3), np.int64)  # z, y, x
    there = tree.directory >= 0
    at[tree.directory[there]] = np.argwhere(there)
    padded = np.pad(tree.directory, 1, constant_values=-1)  # empty outside
    spans = np.maximum(1, tree.frame.cells >> tree.coarse_level)
    out = np.empty((3, *values.shape), depth.dtype)
    for axis in range(3):
        along = np.moveaxis(values, 1 + axis, 1)
        near, far = [], []
        for side in (0, 1):
            beside = at + 1
            beside[:, axis] += 2 * side - 1
            entry = padded[tuple(beside.T)]
            inner, leaf = entry >= 0, -1 - entry[entry < 0]
            ends = np.empty((tree.slots, BRICK, BRICK), depth.dtype)
            ends[inner] = along[entry[inner], 0 if side else -1]
            ends[~inner] = depth[tree.slots * _CELLS + leaf, None, None]
            distance = np.ones((tree.slots, BRICK, 1, 1), depth.dtype)
            distance[~inner, -1 if side else 0, 0, 0] = np.where(
                depth[tree.slots * _CELLS + leaf] > 0, (1 + spans[leaf]) / 2, 1.0
            )
            parts = [along[:, 1:], ends[:, None]] if side else [ends[:, None], along[:, :-1]]
            near.append(np.concatenate(parts, axis=1))
            far.append(distance)
        slope = limited(along, *near, down=far[0], up=far[1])
        out[2 - axis] = np.moveaxis(slope, 1, 1 + axis)
    return out.reshape(3, -1)


def linear_of(cells: OpticalCells) -> LinearCoefficients:
    """Gradients of the coefficients in cells."""
    albedo = np.zeros(len(cells.depth))
    albedo[cells.address] = cells.albedo
    emitted = {name: cells.emitted[name] for name in cells.needs.emitters}
    return LinearCoefficients.of(cells.tree, albedo, emitted)


def middles_of(cells: OpticalCells) -> OpticalCells:
    """Cells with albedo and emission of their middles in place of the means."""
    linear = linear_of(cells)
    emitted = dict(cells.emitted)
    for name, gradient in zip(cells.needs.emitters, linear.emission, strict=True):
        emitted[name] = cells.emitted[name] - linear.excess(gradient)
    excess = linear.excess(linear.albedo)[cells.address]
    return replace(
        cells, emitted=emitted, albedo=cells.albedo - excess, coalbedo=cells.coalbedo + excess
    )


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
    linear: true if coefficients are linear in cells.
    """

    cells: OpticalCells
    at: Ints
    number: NDArray[np.int32]
    linear: bool = False

    @classmethod
    def of(cls, cells: OpticalCells, *, linear: bool = False) -> RecordsTwin:
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
        cells, needs, linear = self.cells, self.cells.needs, linear_of(self.cells)
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
        middles = middles_of(cells) if self.linear else cells
        thermal = middles.thermal_planes(real, self.at).T
        head = cells.depth[self.at, None].astype(real)
        if self.linear:
            head = np.column_stack([head, linear_of(cells).extinction[self.at].astype(real)])
        if not needs.scattering:
            return np.column_stack([head, thermal])
        albedo_at = head.shape[1]
        first = albedo_at if thick is None else albedo_at + 1
        parts = len(needs.components) + 1
        out = np.zeros((len(self.at), first + parts * len(listed)), real)
        out[:, :albedo_at] = head
        row = self.number[cells.address]
        if thick is not None:
            out[row[thick], albedo_at] = middles.albedo[thick]
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
                value[thick, -1] = (middles.coalbedo + made)[thick]
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
