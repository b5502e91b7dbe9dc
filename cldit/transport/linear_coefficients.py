"""Coefficients that are linear in cells, for all rays but the sweeps'.

What vapour absorbs, and what droplets absorb and scatter, have gradients of their own, found from
the neighbours (relative_gradient.py). The extinction is their sum, k (1 + g . x) from the cell's
middle. Emission over extinction and
albedo change within the cell as well: without that T_app, in which the extinction nearly cancels,
gains nothing. They are linear too, to first order, and their middle values are set so that a cell
emits and scatters in all what its means say: the mean of (1 + g . x)(S + s . x) is S + g . s / 12.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.medium.octree import Octree
from cldit.transport.discrete_ordinates.limiter import limit
from cldit.transport.relative_gradient import relative_gradient

Floats = NDArray[np.floating]
# As |g| is 2 at most, a value of |s| up to 3/2 S has 3/4 S in the middle at least, and falls by 3/4
# S to a corner: to 0, not below.
MOST = 4.0 / 3.0
_EXTINCTION = ("vapour_absorption", "droplet_absorption", "droplet_scattering")
_MEAN = 1.0 / 12.0  # of x^2 in a cell of edge 1
_TOGETHER = 2**18  # cells, for memory


@dataclass(frozen=True)
class LinearCoefficients:
    """Gradients along x, y, z per finest cell, (P, 3), of stored cells and coarse leaves.

    extinction: over its mean.
    albedo: of the scattered share of the extinction.
    emission: (E, P, 3) of the emission over extinction of each emitter, in its unit.
    edge: (P,) of the cell or leaf, in finest cells.
    """

    extinction: Floats
    albedo: Floats
    emission: Floats
    edge: Floats

    @classmethod
    def of(cls, tree: Octree, albedo: Floats, emitted: Mapping[str, Floats]) -> LinearCoefficients:
        """From the coefficients of a tree.

        Args:
            tree: the medium.
            albedo: (P,) of all stored cells and coarse leaves.
            emitted: (P,) emission over extinction of `vapour` and `liquid`, where they are there.
        """
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
            # No more is scattered than is taken, nor anything below 0. All gradients of a cell
            # shrink alike, so that in an isothermal cavity they still sum to 0.
            reach = np.abs(part[:, 0]).sum(axis=0) * np.float32(MOST / 2)
            room = (1 - mean[0, some]) / np.maximum(reach, np.float32(1e-20))
            part *= np.clip(room, 0, 1)
            limit(part, mean[:, some] / np.float32(MOST), 1)
            change[:, :, some] = part / edge[some]
        return cls(extinction, change[:, 0].T, change[:, 1:].transpose(1, 2, 0), edge)

    def excess(self, gradient: Floats) -> Floats:
        """Mean, weighted by extinction, less the value in the middle, (P,), of gradients (P, 3)."""
        product = np.einsum("pi,pi->p", self.extinction, gradient)
        return np.asarray(product * self.edge**2 * np.float32(_MEAN))
