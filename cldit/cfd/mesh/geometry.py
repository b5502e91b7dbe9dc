"""Volume, centroid and bounds of polyhedra, in compiled loops that keep only the results.

A face is split into triangles about its mean corner, a cell into pyramids that meet in the mean of
its face centres (as in OpenFOAM, primitiveMeshTools::makeCellCentresAndVols).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints
from cldit.spray.numba_typing import compiled

AnyFloats = NDArray[np.floating]
AnyLabels = NDArray[np.signedinteger]

FEW_FACES, OPEN, NO_VOLUME = 1, 2, 3
_OPEN = 0.01  # share of a cell's surface that may be missing; the slack is for float32 points
_MOST = 64  # faces of a cell, and corners of a face, for which there is room at first


@compiled
def measure(
    points_m: AnyFloats,
    corners: AnyLabels,
    start: AnyLabels,
    first: AnyLabels,
    sides: AnyLabels,
    members: AnyLabels,
    origin_m: Floats,
    rotation: Floats,
    volume_m3: Floats,
    centroid_m: Floats,
    lower_m: Floats,
    upper_m: Floats,
    fault: NDArray[np.int8],
) -> None:
    """Measures the cells `members` (N,) of `Polyhedra`, seen from `origin_m` and rotated.

    The other arrays are written: volume_m3 (N,), centroid_m, lower_m, upper_m (N, 3), and fault
    (N,): 0, or the code of a fault, and then the results of the cell are undefined.
    """
    centre, area = np.empty((_MOST, 3)), np.empty((_MOST, 3))
    ring, triangles = np.empty((_MOST, 3)), np.empty((_MOST, 3))
    middle, tip = np.empty(3), np.empty(3)
    for n in range(len(members)):
        begin, end = first[members[n]], first[members[n] + 1]
        count = end - begin
        fault[n] = 0
        if count < 4:
            fault[n] = FEW_FACES
            continue
        if count > len(centre):
            centre, area = np.empty((2 * count, 3)), np.empty((2 * count, 3))
        lower_m[n] = np.inf
        upper_m[n] = -np.inf
        tip[:] = 0.0
        surface = 0.0
        missing_x = missing_y = missing_z = 0.0
        for k in range(count):
            side = sides[begin + k]
            face, sign = (side, 1.0) if side >= 0 else (-1 - side, -1.0)
            a, b = start[face], start[face + 1]
            if b - a > len(ring):
                ring, triangles = np.empty((2 * (b - a), 3)), np.empty((2 * (b - a), 3))
            middle[:] = 0.0
            for c in range(b - a):
                point = corners[a + c]
                x = points_m[point, 0] - origin_m[0]
                y = points_m[point, 1] - origin_m[1]
                z = points_m[point, 2] - origin_m[2]
                for i in range(3):
                    place = rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z
                    ring[c, i] = place
                    middle[i] += place
                    lower_m[n, i] = min(lower_m[n, i], place)
                    upper_m[n, i] = max(upper_m[n, i], place)
            middle /= b - a
            area[k] = 0.0
            for c in range(b - a):
                d = c + 1 if c + 1 < b - a else 0
                ax, ay, az = (
                    ring[d, 0] - ring[c, 0],
                    ring[d, 1] - ring[c, 1],
                    ring[d, 2] - ring[c, 2],
                )
                bx, by, bz = middle[0] - ring[c, 0], middle[1] - ring[c, 1], middle[2] - ring[c, 2]
                triangles[c, 0] = 0.5 * (ay * bz - az * by)
                triangles[c, 1] = 0.5 * (az * bx - ax * bz)
                triangles[c, 2] = 0.5 * (ax * by - ay * bx)
                for i in range(3):
                    area[k, i] += triangles[c, i]
            # each triangle signed by the face's own normal: a notch in the polygon counts as one
            total = 0.0
            centre[k] = 0.0
            for c in range(b - a):
                d = c + 1 if c + 1 < b - a else 0
                weight = 0.0
                for i in range(3):
                    weight += triangles[c, i] * area[k, i]
                total += weight
                for i in range(3):
                    centre[k, i] += weight * (ring[c, i] + ring[d, i] + middle[i]) / 3.0
            size = 0.0
            for i in range(3):
                # a face without area has no weight in any sum
                centre[k, i] = centre[k, i] / total if total > 0.0 else middle[i]
                area[k, i] *= sign
                size += area[k, i] * area[k, i]
                tip[i] += centre[k, i]
            surface += size**0.5
            missing_x += area[k, 0]
            missing_y += area[k, 1]
            missing_z += area[k, 2]
        # outward area vectors of a closed cell sum to nothing
        if (missing_x**2 + missing_y**2 + missing_z**2) ** 0.5 > _OPEN * surface:
            fault[n] = OPEN
            continue
        tip /= count
        volume = 0.0
        centroid_m[n] = 0.0
        for k in range(count):
            pyramid = 0.0
            for i in range(3):
                pyramid += area[k, i] * (centre[k, i] - tip[i]) / 3.0
            volume += pyramid
            for i in range(3):
                centroid_m[n, i] += pyramid * (centre[k, i] - tip[i])
        # faces that all point inwards (some exporters) turn every sign: the cell is the same
        volume_m3[n] = abs(volume)
        if not volume_m3[n] > 0.0:
            fault[n] = NO_VOLUME
            continue
        for i in range(3):
            centroid_m[n, i] = tip[i] + 0.75 * centroid_m[n, i] / volume


@compiled
def sides_of_cells(
    owner: AnyLabels, neighbour: AnyLabels, first: Ints, sides: NDArray[np.int32]
) -> None:
    """Sorts faces by cell, from owner and neighbour (F,); a neighbour of -1 is none.

    Written: first (C + 1,), zeros before: the first side of each cell; sides: f for the owner,
    -1 - f for the neighbour.
    """
    for face in range(len(owner)):
        first[owner[face] + 1] += 1
        if neighbour[face] >= 0:
            first[neighbour[face] + 1] += 1
    for cell in range(1, len(first)):  # np.cumsum into it takes the compiler ten times as long
        first[cell] += first[cell - 1]
    place = first[:-1].copy()
    for face in range(len(owner)):
        cell = owner[face]
        sides[place[cell]] = face
        place[cell] += 1
        cell = neighbour[face]
        if cell >= 0:
            sides[place[cell]] = -1 - face
            place[cell] += 1


@compiled
def walk_faces(numbers: AnyLabels, place: Ints) -> int:
    """Finds faces that are stored one after the other, each as its size and its corners.

    Written: place (F + 1,), the index of each face's size, and the end of the last face, which is
    also returned: it is not `len(numbers)` if the numbers are no such list.
    """
    here = 0
    for face in range(len(place) - 1):
        place[face] = here
        if here < len(numbers) and numbers[here] > 0:
            here += 1 + numbers[here]
        else:
            here += 1 + len(numbers)
    place[-1] = here
    return here
