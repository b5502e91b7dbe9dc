"""How much of a turn about an axis a mesh fills."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from cldit.cfd.cell_mesh import AnyFloats
from cldit.spray.result import Floats

_NEAR_AXIS = 1e-3  # share of the mesh's width; azimuths of points nearer to the axis mean little
_BINS = 36_000  # of azimuth; gaps narrower than one are no gaps
_PLANE = 1e-4  # radians by which points of a plane through the axis may miss it


def azimuth_span(
    points: Callable[[], Iterable[AnyFloats]], centre_m: Floats, axis: Floats
) -> tuple[float, bool]:
    """Degrees about an axis that points fill, and whether planes through the axis bound them.

    Args:
        points: yields all points, (P, 3) of some at a time; is called three times.
        centre_m, axis: (3,) each, the axis of length 1.

    Returns:
        360 less the widest gap between azimuths; true where both sides of the gap have points at
        several distances from the axis, as a plane through the axis has.
    """
    first = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = first - (first @ axis) * axis
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(axis, first)], axis=1)

    def polar() -> Iterator[tuple[Floats, Floats]]:
        for some in points():
            x, y = ((some - centre_m) @ across).T
            yield np.arctan2(y, x), np.hypot(x, y)

    farthest = max(float(radius.max(initial=0.0)) for _, radius in polar())

    def far() -> Iterator[tuple[Floats, Floats]]:
        for angle, radius in polar():
            kept = radius > _NEAR_AXIS * farthest
            yield angle[kept], radius[kept]

    low, high = np.full(_BINS, np.inf), np.full(_BINS, -np.inf)
    for angle, _ in far():
        place = np.minimum((angle + np.pi) * (_BINS / (2 * np.pi)), _BINS - 1).astype(np.int64)
        np.minimum.at(low, place, angle)
        np.maximum.at(high, place, angle)
    filled = np.flatnonzero(high >= low)
    if not len(filled):
        return 360.0, False
    low, high = low[filled], high[filled]
    gaps = np.append(low[1:], low[0] + 2 * np.pi) - high
    widest = int(np.argmax(gaps))
    ends = high[widest], low[(widest + 1) % len(low)]
    nearest, widest_m = np.full(2, np.inf), np.zeros(2)
    for angle, radius in far():
        for side, end in enumerate(ends):
            on = radius[np.abs((angle - end + np.pi) % (2 * np.pi) - np.pi) < _PLANE]
            nearest[side] = min(nearest[side], on.min(initial=np.inf))
            widest_m[side] = max(widest_m[side], on.max(initial=0.0))
    planes = bool(np.all(widest_m > 1.5 * nearest))
    return float(np.degrees(2 * np.pi - gaps[widest])), planes
