"""Ways of parallel rays through the layers of a box: the steps in which they cross cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SHORTEST = 1e-6  # of a layer: what a ray crosses in less is left to the step beside it
# Less than this of how light changes does not count for more, in `visible_gradient`: it is chance.
_SHOWS = 0.5


def visible_gradient(slope: Floats) -> Floats:
    """Part of how light changes across cells that shows between places of a layer's rays in their
    cells and the mean of these places, on average over where rays start.

    slope: cells that rays move a layer, -1 to 1. That mean varies by (1 - |slope|)^2 / 12, of the
    1/12 of all places in a cell. The part is taken for a half where it is less.
    """
    rest = 1.0 - np.minimum(np.abs(slope), 1.0)
    return np.maximum(1.0 - rest**2, _SHOWS)


@dataclass(frozen=True)
class Segments:
    """Steps (N,), of one way (K,) after the other, between the places where rays go from one cell
    into another.

    way: of which it is one. part: share of its layer that a step crosses. met: the layer, counted
    as rays meet them. moved (N, 2): cells by which rays have moved along u and v since they came
    in. within (N, 3): where in its cell the step's middle lies along u, v, l, 0 to 1. leaves
    (N, 3): along which of u, v, l rays go on into another cell after the step; after a layer's last
    also along those on which no step of the layer has them do.

    lever (N, 3): the place `within`, from the mean of the layer's steps on, times gain (K, 3): 1
    over what is `visible_gradient` of a change along u and v. All cells of a layer are crossed
    alike. So light
    times the place, summed over directions, tells on which side of every cell rays happen to lie,
    and how bright these are; times the lever it tells how light changes, and nothing of that.
    """

    way: NDArray[np.int64]
    part: Floats
    met: NDArray[np.int64]
    moved: NDArray[np.int64]
    within: Floats
    leaves: NDArray[np.bool_]
    basis: Floats
    gain: Floats

    @classmethod
    def of(
        cls, slopes: Floats, starts: Floats, *, layers: int, backwards: NDArray[np.bool_]
    ) -> Segments:
        """slopes (K, 2): cells that rays move along u and v in a layer, -1 to 1; starts (K, 2):
        where they cross the first layer's cells, 0 to 1. backwards (K,): the last layer is met
        first."""
        way, at = _cuts(slopes, starts, layers)
        inside = np.flatnonzero(way[1:] == way[:-1])
        way, part, middle = way[inside], np.diff(at)[inside], at[inside]
        middle += part / 2
        met, along = np.floor(middle).astype(np.int64), middle % 1
        across = starts[way] + slopes[way] * middle[:, None]
        moved = np.floor(across).astype(np.int64)
        layer, count = way * layers + met, len(slopes) * layers  # of all ways
        last = np.diff(layer, append=count) > 0
        leaves = np.empty((len(way), 3), bool)
        leaves[:, 2] = last
        place = np.empty((len(way), 3))
        place[:, :2], place[:, 2] = across % 1, np.where(backwards[way], 1 - along, along)
        mean = np.full(place.shape, 0.5)
        for axis in (0, 1):
            goes = ~last & (np.diff(moved[:, axis], append=0) != 0)
            never = np.bincount(layer, goes, minlength=count) == 0
            leaves[:, axis] = goes | (last & never[layer])
            mean[:, axis] = np.bincount(layer, part * place[:, axis], minlength=count)[layer]
        gain = np.column_stack([1.0 / visible_gradient(slopes), np.ones(len(slopes))])
        return cls(
            way=way,
            part=part,
            met=met,
            moved=moved,
            within=place,
            leaves=leaves,
            basis=gain[way] * (place - mean),
            gain=gain,
        )

    def shifts(self) -> NDArray[np.int32]:
        """(N, 4): moved in u, in v, and both since the step before; there 2 where rays come into
        the box."""
        since = np.diff(self.moved, axis=0, prepend=self.moved[:1])
        since[np.diff(self.way, prepend=-1) > 0] = 2
        return np.column_stack([self.moved, since]).astype(np.int32)


def _cuts(slopes: Floats, starts: Floats, layers: int) -> tuple[NDArray[np.int64], Floats]:
    """Where steps begin and end, 0 to `layers`, of one way after the other; and of which."""
    end = starts + slopes * layers
    low, high = np.ceil(np.minimum(starts, end)), np.floor(np.maximum(starts, end))
    sides = low[:, :, None] + np.arange(layers + 1.0)  # between cells along u and v
    met = sides - starts[:, :, None]
    met /= np.where(slopes == 0, 1.0, slopes)[:, :, None]
    met[(sides > high[:, :, None]) | (slopes == 0)[:, :, None]] = 0.0  # one that is there already
    between = np.broadcast_to(np.arange(layers + 1.0), (len(slopes), layers + 1))
    at = np.concatenate([between, met.reshape(len(slopes), -1)], axis=1)
    at = np.sort(np.clip(at, 0.0, layers), axis=1)
    way, place = np.nonzero(np.diff(at, axis=1, prepend=-1.0) > 0)
    at = at[way, place]
    # Of two cuts that are all but one the later goes, unless it is the layer's end.
    close = np.flatnonzero((np.diff(at) < _SHORTEST) & (np.diff(way) == 0))
    gone = np.where(at[close + 1] % 1 == 0, close, close + 1)
    return np.delete(way, gone), np.delete(at, gone)
