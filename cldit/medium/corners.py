"""Corners of boxes in a cube as whole numbers, which serve the cells of every depth.

The cube's edge has 2^31 units, 0.1 nm of 0.2 m, to which corners are rounded: faces that two boxes
share stay shared, and a cell of depth d is found by a shift of 31 - d bits, on every device alike.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import MediumError
from cldit.gpu.buffers import Numbers, upload
from cldit.gpu.device import Device
from cldit.medium.frame import AT_ONCE, TOLERANCE, Cube

BITS = 31  # of the cube's edge


def refuse(frame: Cube, content: str, share: float, place_m: Floats) -> NoReturn:
    """Raises MediumError: a share of the content, in places (N, 3), is outside a cube."""
    corner, low, high = np.asarray(frame.lower_m), place_m.min(axis=0), place_m.max(axis=0)
    raise MediumError(
        f"{100 * share:.3g} % of the {content} is outside the domain: at "
        f"{np.round(low, 4).tolist()} to {np.round(high, 4).tolist()} m; the cube reaches from "
        f"{np.round(corner, 4).tolist()} to {np.round(corner + frame.edge_m, 4).tolist()} m; "
        "enlarge domain.edge_m or move domain.centre_m"
    )


@dataclass(frozen=True, eq=False)
class Corners:
    """Lower and upper corners (3, N; x, y, z) of boxes, in units of 2^-31 of the cube's edge."""

    low: NDArray[np.uint32]
    high: NDArray[np.uint32]
    _buffers: weakref.WeakKeyDictionary[Any, list[tuple[slice, Numbers]]] = field(
        default_factory=weakref.WeakKeyDictionary, repr=False
    )

    @classmethod
    def of(cls, cube: Cube, lower_m: Floats, upper_m: Floats, content: str) -> Corners:
        """Boxes (N, 3); raises MediumError, which names `content`, if one reaches out of a cube."""
        corners = np.empty((2, 3, len(lower_m)))
        for corner, place_m in zip(corners, (lower_m, upper_m), strict=True):
            for along, at_m, origin_m in zip(corner, place_m.T, cube.lower_m, strict=True):
                np.subtract(at_m, origin_m, out=along)
        corners /= cube.edge_m
        # Rounding may place a corner two units outside, 1e-9 of the edge.
        slack = 2.0 ** (1 - BITS) * (1.0 + np.abs(corners[0]).max(initial=0.0))
        lowest, highest = corners.min(initial=0.0), corners.max(initial=1.0)
        if lowest < -slack or highest > 1.0 + slack:
            outside = np.any((corners < -slack) | (corners > 1.0 + slack), axis=(0, 1))
            places_m = np.concatenate([lower_m[outside], upper_m[outside]])
            refuse(cube, f"{content} (cells)", float(np.mean(outside)), places_m)
        np.clip(corners, 0.0, 1.0, out=corners)
        corners *= 2.0**BITS
        low, high = np.rint(corners, out=corners).astype(np.uint32)
        return cls(low, np.maximum(high, low + 1))  # no box is without width

    def cells(self, depth: int) -> NDArray[np.int32] | None:
        """Finest cell (N, 3) of each box, to within `TOLERANCE`; None if one is in several."""
        shift, slack = BITS - depth, np.uint32(TOLERANCE * 2.0 ** (BITS - depth))
        cells = np.empty(self.low.shape, np.int32)
        for cell, low, high in zip(cells, self.low, self.high, strict=True):
            cell[:] = np.minimum((low + slack) >> shift, 2**depth - 1)
            if np.any((np.maximum(high, slack + 1) - (slack + 1)) >> shift > cell):
                return None
        return cells.T

    def on(self, device: Device) -> Iterator[tuple[slice, Numbers]]:
        """Parts of the boxes and their corners on a device, (6, n), which stay there."""
        if device.opened not in self._buffers:
            count, stacked = self.low.shape[1], np.vstack([self.low, self.high])
            parts = [slice(n, min(n + AT_ONCE, count)) for n in range(0, count, AT_ONCE)]
            buffers = [upload(device, "boxes", stacked[:, part]) for part in parts]
            self._buffers[device.opened] = list(zip(parts, buffers, strict=True))
        return iter(self._buffers[device.opened])
