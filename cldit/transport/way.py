"""The way of parallel rays through the layers of a box: the steps in which they cross cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SHORTEST = 1e-6  # of a layer: what a ray crosses in less is left to the step beside it
# Less than this of how light changes does not count for more, in `shown`: it is chance.
_SHOWS = 0.5


def shown(slope: Floats) -> Floats:
    """Part of how light changes across cells that shows between places of a layer's rays in their
    cells and the mean of these places, on average over where rays start.

    slope: cells that rays move a layer, -1 to 1. That mean varies by (1 - |slope|)^2 / 12, of the
    1/12 of all places in a cell. The part is taken for a half where it is less.
    """
    rest = 1.0 - np.minimum(np.abs(slope), 1.0)
    return np.maximum(1.0 - rest**2, _SHOWS)


@dataclass(frozen=True)
class Way:
    """Steps (N,) between the places where rays go from one cell into another.

    part: share of its layer that a step crosses. layer: in which it is. moved_u, moved_v: cells by
    which rays have moved since they came in. within (3, N): where in its cell the step's middle
    lies along u, v, l, 0 to 1. leaves (3, N): along which of u, v, l rays go on into another cell
    after the step; after a layer's last also along those on which no step of the layer has them do.

    lever (3, N): the place `within`, from the mean of the layer's steps on, times gain (3,): 1 over
    what is `shown` of a change along u and v. All cells of a layer are crossed alike. So light
    times the place, summed over directions, tells on which side of every cell rays happen to lie,
    and how bright these are; times the lever it tells how light changes, and nothing of that.
    """

    part: Floats
    layer: NDArray[np.int32]
    moved_u: NDArray[np.int64]
    moved_v: NDArray[np.int64]
    within: Floats
    leaves: NDArray[np.bool_]
    lever: Floats
    gain: Floats

    @classmethod
    def of(
        cls, slope_u: float, slope_v: float, start: Floats, *, layers: int, backwards: bool
    ) -> Way:
        """slope_u, slope_v: cells that rays move a layer, -1 to 1; start (2,): where they cross the
        first layer's cells, 0 to 1. backwards: the last layer is met first."""
        cuts = [np.arange(layers + 1.0)]
        for slope, first in ((slope_u, start[0]), (slope_v, start[1])):
            if slope != 0:
                end = first + slope * layers
                low, high = sorted((first, end))
                cuts.append((np.arange(np.ceil(low), np.floor(high) + 1) - first) / slope)
        at = np.unique(np.clip(np.concatenate(cuts), 0.0, layers))
        # Of two cuts that are all but one the later goes, unless it is the layer's end.
        close = np.flatnonzero(np.diff(at) < _SHORTEST)
        at = np.delete(at, np.where(at[close + 1] % 1 == 0, close, close + 1))
        part = np.diff(at)
        middle = at[:-1] + part / 2
        u, v = start[0] + slope_u * middle, start[1] + slope_v * middle
        layer, along = np.floor(middle).astype(np.int32), middle % 1
        moved_u, moved_v = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
        last = np.diff(layer, append=layers) > 0
        across = []
        for moved in (moved_u, moved_v):
            goes = ~last & (np.diff(moved, append=moved[-1]) != 0)
            never = np.bincount(layer, goes, minlength=layers) == 0
            across.append(goes | (last & never[layer]))
        within = np.stack([u % 1, v % 1, 1 - along if backwards else along])
        mean = np.full(within.shape, 0.5)
        for level, place in zip(mean[:2], within[:2], strict=True):
            level[:] = np.bincount(layer, part * place, minlength=layers)[layer]
        gain = np.array([*(1.0 / shown(np.array([slope_u, slope_v]))), 1.0])
        return cls(
            part=part,
            layer=layers - 1 - layer if backwards else layer,
            moved_u=moved_u,
            moved_v=moved_v,
            within=within,
            leaves=np.stack([*across, last]),
            lever=gain[:, None] * (within - mean),
            gain=gain,
        )

    def shifts(self) -> NDArray[np.int32]:
        """(N, 4): moved in u, in v, and both since the step before; there 2 where rays come into
        the box."""
        moved = np.stack([self.moved_u, self.moved_v], axis=1)
        since = np.diff(moved, axis=0, prepend=moved[:1])
        since[0] = 2
        return np.column_stack([moved, since]).astype(np.int32)
