"""Segments of parallel rays through the layers of a box (method of long characteristics).

Discrete ordinates sweeps (kernels/sweep.cl, stages 1 to 3 of `trace_source`) cross cells along
them. All cells of a layer have the same segments.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask


def visible_gradient(slope: Floats) -> Floats:
    """Share of a spatial gradient, 0.5 to 1, that the rays of a layer resolve.

    `slope`, of any shape, is the number of cells that rays move along an axis in one layer, -1 to
    1. The mean place of a layer's segments in their cells has the variance (1 - |slope|)^2 / 12
    over the starts of rays, of the 1/12 of all places in a cell. Only the rest is resolved; at
    least a half is assumed.
    """
    rest = 1.0 - np.minimum(np.abs(slope), 1.0)
    # Less than a half would amplify noise.
    return np.maximum(1.0 - rest**2, 0.5)


@dataclass(frozen=True)
class Segments:
    """N segments between cell faces, for K ordinates one after the other.

    ordinate: (N,) number.
    layer_share: (N,) share of its layer that a segment crosses.
    layer: (N,) in the order of the sweep.
    shift: (N, 2) cells by which rays have moved along u and v since they entered.
    midpoint: (N, 3) position of the segment's middle in its cell along u, v, l, 0 to 1.
    exits: (N, 3) true if rays enter another cell along u, v, l after the segment. A layer's last
        segment also has the axes along which no segment of the layer does.
    basis: (N, 3) zero-mean basis for spatial moments: the midpoint less its mean over the layer,
        times basis_scale. With the mean, moments would depend on the random starts of the rays.
    basis_scale: (K, 3) 1 / `visible_gradient` along u and v, 1 along l.
    """

    ordinate: Ints
    layer_share: Floats
    layer: Ints
    shift: Ints
    midpoint: Floats
    exits: Mask
    basis: Floats
    basis_scale: Floats

    @classmethod
    def of(cls, slopes: Floats, starts: Floats, *, layers: int, backwards: Mask) -> "Segments":
        """Segments of K ordinates.

        Args:
            slopes: (K, 2) cells that rays move along u and v in a layer, -1 to 1.
            starts: (K, 2) positions of rays in the first layer's cells, 0 to 1.
            backwards: (K,) true if rays enter the last layer first.
        """
        ordinate, at = _cuts(slopes, starts, layers)
        inside = np.flatnonzero(ordinate[1:] == ordinate[:-1])
        ordinate, share, middle = ordinate[inside], np.diff(at)[inside], at[inside]
        middle += share / 2
        layer, along = np.floor(middle).astype(np.int64), middle % 1
        lateral = starts[ordinate] + slopes[ordinate] * middle[:, None]
        shift = np.floor(lateral).astype(np.int64)
        crossed_layer = ordinate * layers + layer
        count = len(slopes) * layers
        ends_layer = np.diff(crossed_layer, append=count) > 0
        exits = np.empty((len(ordinate), 3), bool)
        exits[:, 2] = ends_layer
        place = np.empty((len(ordinate), 3))
        place[:, :2], place[:, 2] = lateral % 1, np.where(backwards[ordinate], 1 - along, along)
        mean = np.full(place.shape, 0.5)
        for axis in (0, 1):
            enters = ~ends_layer & (np.diff(shift[:, axis], append=0) != 0)
            never = np.bincount(crossed_layer, enters, minlength=count) == 0
            exits[:, axis] = enters | (ends_layer & never[crossed_layer])
            mean[:, axis] = np.bincount(crossed_layer, share * place[:, axis], minlength=count)[
                crossed_layer
            ]
        scale = np.column_stack([1.0 / visible_gradient(slopes), np.ones(len(slopes))])
        return cls(
            ordinate=ordinate,
            layer_share=share,
            layer=layer,
            shift=shift,
            midpoint=place,
            exits=exits,
            basis=scale[ordinate] * (place - mean),
            basis_scale=scale,
        )

    def shifts(self) -> NDArray[np.int32]:
        """Table (N, 4) for kernels/sweep.cl: shift in u and v, and their change, 2 at the entry."""
        since = np.diff(self.shift, axis=0, prepend=self.shift[:1])
        since[np.diff(self.ordinate, prepend=-1) > 0] = 2
        return np.column_stack([self.shift, since]).astype(np.int32)


def _cuts(slopes: Floats, starts: Floats, layers: int) -> tuple[Ints, Floats]:
    """Ordinates and positions, 0 to `layers`, of the ends of segments, ordinate by ordinate."""
    end = starts + slopes * layers
    low, high = np.ceil(np.minimum(starts, end)), np.floor(np.maximum(starts, end))
    sides = low[:, :, None] + np.arange(layers + 1.0)  # between cells along u and v
    crossed = sides - starts[:, :, None]
    crossed /= np.where(slopes == 0, 1.0, slopes)[:, :, None]
    crossed[(sides > high[:, :, None]) | (slopes == 0)[:, :, None]] = 0.0  # a cut already
    between = np.broadcast_to(np.arange(layers + 1.0), (len(slopes), layers + 1))
    at = np.concatenate([between, crossed.reshape(len(slopes), -1)], axis=1)
    at = np.sort(np.clip(at, 0.0, layers), axis=1)
    ordinate, place = np.nonzero(np.diff(at, axis=1, prepend=-1.0) > 0)
    at = at[ordinate, place]
    # If two cuts almost coincide, the later is dropped, unless it is the layer's end.
    close = np.flatnonzero((np.diff(at) < 1e-6) & (np.diff(ordinate) == 0))
    dropped = np.where(at[close + 1] % 1 == 0, close, close + 1)
    return np.delete(ordinate, dropped), np.delete(at, dropped)
