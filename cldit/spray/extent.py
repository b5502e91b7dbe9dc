"""Distribution of a parcel's droplets about its position: uniform in a box, or a cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.errors import SprayError


@dataclass(frozen=True)
class Box:
    """Uniform distribution in a box with edges (3,) along x, y, z: the cells of the field itself.

    The parcels are then not a sample.
    """

    edge_m: Floats

    def __post_init__(self) -> None:
        if self.edge_m.shape != (3,):
            raise SprayError(f"box.edge_m: shape {self.edge_m.shape}, expected (3,)")
        if not np.all((self.edge_m >= 1e-9) & (self.edge_m <= 1e3)):
            raise SprayError(f"box.edge_m: {self.edge_m.tolist()} is outside 1e-9..1e3")

    def of(self, _: Mask) -> Box:
        """Extent of some of the parcels (N,)."""
        return self


@dataclass(frozen=True)
class Cloud:
    """Distribution of compact support with a covariance (N, 3, 3) in m2, in x, y, z."""

    covariance_m2: Floats

    def __post_init__(self) -> None:
        shape = self.covariance_m2.shape
        if len(shape) != 3 or shape[1:] != (3, 3):
            raise SprayError(f"cloud.covariance_m2: shape {shape}, expected (N, 3, 3)")
        bad = ~np.all(np.isfinite(self.covariance_m2), axis=(1, 2))
        bad |= np.any(np.diagonal(self.covariance_m2, axis1=1, axis2=2) < 0, axis=1)
        if np.any(bad):
            raise SprayError(f"cloud.covariance_m2: entry {int(np.argmax(bad))} is no covariance")

    def of(self, chosen: Mask) -> Cloud:
        """Extent of the `chosen` parcels (N,)."""
        return Cloud(self.covariance_m2[chosen])


Extent = Box | Cloud
