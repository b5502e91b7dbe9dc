"""Patches of the enclosure as kernels/boundary.h reads them: a disc or a rectangle in a plane.

A patch is four rows of four numbers; lengths are in finest cells:

    normal x, y, z and the plane's offset, normal . p = offset
    centre x, y, z; 0 for a disc (or an ellipse), 1 for a rectangle
    unit vector across / half the width; 0
    unit vector along the height / half the height; 0
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cldit.medium.frame import Frame
from cldit.scene.vessel import Patch

Floats = NDArray[np.float64]

NONE: Floats = np.zeros((0, 4, 4))
_UPRIGHT = 0.999  # cosine to the z axis above which a patch faces up or down


def patch_rows(patches: Sequence[Patch], frame: Frame) -> Floats:
    """Rows (P, 4, 4) of patches, see above, in cells from the cube's lower corner.

    The height of a rectangle runs along z, or along y where it faces up or down.
    """
    rows = np.zeros((len(patches), 4, 4))
    for row, patch in zip(rows, patches, strict=True):
        normal = np.asarray(patch.facing) / np.linalg.norm(patch.facing)
        up = np.array([0.0, 1.0, 0.0] if abs(normal[2]) > _UPRIGHT else [0.0, 0.0, 1.0])
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
    """Rows (P, 4, 4) of patches that are shifted by a vector (3,)."""
    out = rows.copy()
    out[:, 0, 3] += rows[:, 0, :3] @ by
    out[:, 1, :3] += by
    return out
