"""How the droplets of a parcel are spread about its place: evenly in a box, or as a cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.errors import SprayError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Box:
    """Evenly in a box about the place, edges along x, y, z (3,): the field's own cells.

    All of the box is known, so nothing is sampled.
    """

    edge_m: Floats

    def __post_init__(self) -> None:
        if self.edge_m.shape != (3,):
            raise SprayError(f"box.edge_m: shape {self.edge_m.shape}, expected (3,)")
        if not np.all((self.edge_m >= 1e-9) & (self.edge_m <= 1e3)):
            raise SprayError(f"box.edge_m: {self.edge_m.tolist()} is outside 1e-9..1e3")

    def of(self, _: NDArray[np.bool_]) -> Box:
        """Gives the extent of some of the parcels, (N,)."""
        return self


@dataclass(frozen=True)
class Cloud:
    """About the place with a covariance (N, 3, 3) in m2, in x, y, z, of compact support."""

    covariance_m2: Floats

    def __post_init__(self) -> None:
        shape = self.covariance_m2.shape
        if len(shape) != 3 or shape[1:] != (3, 3):
            raise SprayError(f"cloud.covariance_m2: shape {shape}, expected (N, 3, 3)")
        bad = ~np.all(np.isfinite(self.covariance_m2), axis=(1, 2))
        bad |= np.any(np.diagonal(self.covariance_m2, axis1=1, axis2=2) < 0, axis=1)
        if np.any(bad):
            raise SprayError(f"cloud.covariance_m2: entry {int(np.argmax(bad))} is no covariance")

    def of(self, chosen: NDArray[np.bool_]) -> Cloud:
        """Gives the extent of the `chosen` parcels, (N,)."""
        return Cloud(self.covariance_m2[chosen])


Extent = Box | Cloud
