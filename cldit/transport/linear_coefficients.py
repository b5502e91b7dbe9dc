"""Coefficients that are linear in cells, for all rays but the sweeps'.

Vapour and droplets have gradients of their own, found from the neighbours (relative_gradient.py).
The extinction is their sum, k (1 + g . x) from the cell's middle. Emission over extinction and
albedo change within the cell as well: without that T_app, in which the extinction nearly cancels,
gains nothing. They are linear too, to first order, and their middle values are set so that a cell
emits and scatters in all what its means say: the mean of (1 + g . x)(S + s . x) is S + g . s / 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.medium.octree import Octree
from cldit.transport.relative_gradient import relative_gradient

Floats = NDArray[np.float32]
# With |g| and |s| / S at most 2, the middle value is 2/3 S at least, less 3/4 of S at a corner of
# what is allowed: nothing is below 0.
MOST = 4.0 / 3.0
_MEAN = 1.0 / 12.0  # of x^2 in a cell of edge 1


@dataclass(frozen=True)
class LinearCoefficients:
    """Gradients along x, y, z per finest cell, (P, 3), of stored cells and coarse leaves.

    extinction: over its mean.
    albedo: over its mean; beside empty cells, and of one phase alone, 0.
    emission: of the emission over extinction, for each of vapour and liquid, over its mean.
    edge: (P,) of the cell or leaf, in finest cells.
    """

    extinction: Floats
    albedo: Floats
    emission: dict[str, Floats]
    edge: Floats

    @classmethod
    def of(cls, tree: Octree) -> LinearCoefficients:
        """From the coefficients of a tree."""
        fields = tree.fields
        vapour = fields["vapour_absorption"]
        droplets = fields["droplet_absorption"] + fields["droplet_scattering"]
        scattering = fields["droplet_scattering"]
        whole = vapour + droplets
        safe = np.where(whole > 0, whole, np.float32(1))
        of_vapour, of_droplets = (relative_gradient(tree, one) for one in (vapour, droplets))
        extinction = (vapour / safe)[:, None] * of_vapour + (droplets / safe)[:, None] * of_droplets
        edge = np.ones(len(whole), np.float32)
        edge[-len(tree.coarse_level) :] = tree.frame.cells >> tree.coarse_level
        # No more is scattered than is taken.
        share = scattering / safe
        room = np.divide(1 - share, share, out=np.ones_like(share), where=share > 0.5)
        emission = {
            name: _shortened(
                relative_gradient(tree, fields[f"{field}_emission"]) - extinction, 1.0, edge
            )
            for name, field in (("vapour", "vapour"), ("liquid", "droplet"))
            if fields[f"{field}_emission"].any()
        }
        albedo = _shortened(of_droplets - extinction, room, edge)
        albedo[scattering <= 0] = 0.0
        return cls(extinction, albedo, emission, edge)

    def middle(self, gradient: Floats) -> Floats:
        """Value (P,) at the middle over the mean, of a source with this relative gradient (P, 3)."""
        product = np.einsum("pi,pi->p", self.extinction, gradient) * self.edge**2
        return np.asarray(1 - np.float32(_MEAN) * product)


def _shortened(gradient: Floats, room: Floats | float, edge: Floats) -> Floats:
    """Relative gradients (P, 3) that change a value by `room` of itself at most, at any corner."""
    reach = np.abs(gradient).sum(axis=1) * edge * np.float32(MOST / 2)
    least = np.float32(1e-20)
    return np.asarray(gradient * np.minimum(room / np.maximum(reach, least), 1)[:, None])
