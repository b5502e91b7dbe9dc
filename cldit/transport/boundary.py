"""Boundary of the medium as kernels/boundary.h has it: background disc, walls and patches.

A patch is a disc or a rectangle in a plane, as four rows of four numbers. Lengths are in finest
cells:

    normal x, y, z and the plane's offset, normal . p = offset
    centre x, y, z; 0 for a disc (or an ellipse), 1 for a rectangle
    unit vector across / half the width; 0
    unit vector along the height / half the height; 0
"""

from collections.abc import Sequence

import numpy as np

from cldit.arrays import Floats, Ints, Mask
from cldit.medium.frame import Cube
from cldit.scene.vessel import Patch

NONE: Floats = np.zeros((0, 4, 4))


def patch_rows(patches: Sequence[Patch], frame: Cube) -> Floats:
    """Rows (P, 4, 4) of `patches`, see above, in cells from the lower corner of `frame`.

    The height of a rectangle runs along z, or along y where it faces up or down.
    """
    rows = np.zeros((len(patches), 4, 4))
    for row, patch in zip(rows, patches, strict=True):
        normal = np.asarray(patch.facing) / np.linalg.norm(patch.facing)
        up = np.array([0.0, 1.0, 0.0] if abs(normal[2]) > 0.999 else [0.0, 0.0, 1.0])
        up -= (up @ normal) * normal
        up /= np.linalg.norm(up)
        centre = frame.to_cells(np.asarray([patch.centre_m]))[0]
        if patch.size_m is not None:
            width_m, height_m = patch.size_m
        else:
            assert patch.radius_m is not None  # as the scene was checked
            width_m = height_m = 2 * patch.radius_m
        row[0] = *normal, centre @ normal
        row[1] = *centre, float(patch.shape == "rectangle")
        row[2, :3] = np.cross(up, normal) / (width_m / frame.cell_m / 2)
        row[3, :3] = up / (height_m / frame.cell_m / 2)
    return rows


def shifted(rows: Floats, by: Floats) -> Floats:
    """`rows` (P, 4, 4) of patches, shifted by a vector `by` (3,)."""
    out = rows.copy()
    out[:, 0, 3] += rows[:, 0, :3] @ by
    out[:, 1, :3] += by
    return out


def sees_disc(point: Floats, toward: Floats, *, centre: Floats, radius: float) -> Mask:
    """True (N,) for lines that hit a disc which faces -y; arguments as in `boundary_seen`."""
    forward = toward[:, 1] > 0
    s = (centre[1] - point[:, 1]) / np.where(forward, toward[:, 1], 1.0)
    hit = point + s[:, None] * toward
    across = (hit[:, 0] - centre[0]) ** 2 + (hit[:, 2] - centre[2]) ** 2
    return np.asarray(forward & (across <= radius**2))


def boundary_seen(
    point: Floats,
    toward: Floats,
    *,
    centre: Floats,
    radius: float,
    patches: Floats,
    start: float = 0.0,
) -> Ints:
    """Component of the boundary (N,) that lines hit: 0 the disc, 1 the walls, 2.. the patches.

    Args:
        point, toward: (N, 3) points of the lines and their unit vectors.
        centre, radius: of the disc, (3,) and in the unit of `point`.
        patches: (P, 4, 4), see above.
        start: least distance from `point` at which patches count.
    """
    s = (centre[1] - point[:, 1]) / np.where(toward[:, 1] > 0, toward[:, 1], 1.0)
    on_disc = sees_disc(point, toward, centre=centre, radius=radius)
    distance = [np.where(on_disc, s, np.inf)]
    for normal, middle, across, up in patches:
        against = -toward @ normal[:3]
        s = (point @ normal[:3] - normal[3]) / np.where(against > 0, against, 1.0)
        inside = point + s[:, None] * toward - middle[:3]
        u, v = np.abs(inside @ across[:3]), np.abs(inside @ up[:3])
        hit = np.maximum(u, v) <= 1 if middle[3] else u**2 + v**2 <= 1
        distance.append(np.where(hit & (against > 0) & (s >= start), s, np.inf))
    nearest = np.argmin(distance, axis=0)  # of equal ones the first
    nothing = np.isinf(np.min(distance, axis=0))
    return np.where(nothing, 1, np.where(nearest == 0, 0, nearest + 1))
