"""Sobol points for path tracing and the final gather, in the format of kernels/random.h.

Direction numbers: Joe and Kuo, SIAM J. Sci. Comput. 30, 2008.
"""

import numpy as np
from numpy.typing import NDArray

BITS = 10  # of a point's index; kernels/random.h has both numbers too
DIMENSIONS = 8

# Primitive polynomial (degree s, coefficients a), and the first s direction integers.
_POLYNOMIALS = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
)


def columns(bits: int = BITS) -> NDArray[np.uint32]:
    """Direction numbers (DIMENSIONS, bits); point i is the exclusive or of those of i's bits.

    The first dimension is the van der Corput sequence.
    """
    out = np.zeros((DIMENSIONS, bits), np.uint32)
    out[0] = [1 << (31 - bit) for bit in range(bits)]
    for dimension, (degree, coefficients, initial) in enumerate(_POLYNOMIALS, start=1):
        m = list(initial)
        while len(m) < bits:
            new = m[-degree] ^ (m[-degree] << degree)
            for k in range(1, degree):
                if coefficients >> (degree - 1 - k) & 1:
                    new ^= m[-k] << k
            m.append(new)
        out[dimension] = [value << (31 - bit) for bit, value in enumerate(m[:bits])]
    return out


def points(first: int, count: int) -> NDArray[np.uint32]:
    """Words (count, DIMENSIONS) of the points first..first + count - 1, below 2^32."""
    number = np.arange(first, first + count, dtype=np.uint32)[:, None]
    out = np.zeros((count, DIMENSIONS), np.uint32)
    for bit, column in enumerate(columns(max(int(first + count - 1).bit_length(), 1)).T):
        out ^= np.where(number >> np.uint32(bit) & np.uint32(1), column, np.uint32(0))
    return out


def net(count: int) -> NDArray[np.float64]:
    """A net (count, 4) of a power of two, in the middles of its rows and columns.

    The first two dimensions are a (0, 2)-net: every part of the unit square of area 1 / count that
    is halved from it has one point.
    """
    return np.asarray(points(0, count)[:, [0, 1, 3, 4]] / 2.0**32 + 0.5 / count)


def on_disc(square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (N, 2) of the unit square, mapped onto the unit disc with equal areas.

    Concentric map of Shirley and Chiu, J. Graph. Tools 2, 1997. Mean and variance of four or more
    points are made those of the disc: blur then moves no image, and has the right width.
    """
    centred = 2.0 * square - 1.0
    steep = np.abs(centred[:, 1]) > np.abs(centred[:, 0])
    centred[steep] = centred[steep, ::-1]
    radius, ordinate = centred.T
    angle = np.pi / 4 * np.divide(ordinate, radius, out=np.zeros(len(radius)), where=radius != 0)
    disc = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    disc[steep] = disc[steep, ::-1]
    disc -= disc.mean(axis=0)
    if len(disc) < 4:
        return disc
    variance, axes = np.linalg.eigh(disc.T @ disc / len(disc))
    return np.asarray(disc @ (axes * (0.5 / np.sqrt(variance))) @ axes.T)
